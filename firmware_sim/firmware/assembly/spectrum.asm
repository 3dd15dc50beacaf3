; Spectra of the gyros, of a board with [spectrum]: the A/D service keeps samples, every SPECTRUM_TICKS ticks the last
; FFT_POINTS of them are a window, the background transforms it, axis by axis, and a period later the tick sends what has
; come out, piece by piece. Two sets of pieces: one is filled while the other is sent.

S_DUE       .set    0       ; ticks to the next window
S_GATHERED  .set    1       ; samples since reset, up to FFT_POINTS
S_BEGUN     .set    2       ; there was a window a period ago
S_LEFT      .set    3       ; axes that the background has to do
S_FIRST     .set    4       ; the first sample of the window
S_NUMBER    .set    5       ; of the transform
S_PACKED    .set    6       ; where the next piece goes to
S_FILLED    .set    7       ; the set that is filled, and the one that is sent
S_SENT      .set    8
S_PIECE     .set    9       ; the next piece to send, and how many there are
S_PIECES    .set    10
spectrum_state .usect "spectrum",11
fft_amplitudes .usect "pieces",FFT_PAIRS
spectrum_sets .usect "pieces",2*SPECTRUM_PIECES*PIECE_WORDS
sample_ring .usect  "samples",RING      ; x, y, z and number of each

            .sect   "services"
spectrum_boot:
            LDI     spectrum_places,AR1
            LDI     spectrum_state,AR0
            LDI     0,R0
            STI     R0,*+AR0(S_DUE)
            STI     R0,*+AR0(S_GATHERED)
            STI     R0,*+AR0(S_BEGUN)
            STI     R0,*+AR0(S_LEFT)
            STI     R0,*+AR0(S_PIECES)
            LDI     -1,R0
            STI     R0,*+AR0(S_NUMBER)
            LDI     *AR1,R0
            STI     R0,@sample_at
            LDI     *+AR1(1),R0
            STI     R0,*+AR0(S_FILLED)
            LDI     *+AR1(2),R0
            STI     R0,*+AR0(S_SENT)
            RETS

; The tick: whether another window begins. What the background has done of the one before goes out then.
spectrum_tick:
            LDI     spectrum_state,AR0
            LDI     *+AR0(S_GATHERED),R0
            ADDI    @taken,R0
            CMPI    FFT_POINTS,R0
            LDIGT   FFT_POINTS,R0
            STI     R0,*+AR0(S_GATHERED)
            LDI     *+AR0(S_DUE),R1
            SUBI    1,R1
            STI     R1,*+AR0(S_DUE)
            RETSGT
            LDI     SPECTRUM_TICKS,R1
            STI     R1,*+AR0(S_DUE)
            LDI     *+AR0(S_LEFT),R1        ; never: build.py refuses a board whose background could be so late
            RETSNZ
            LDI     *+AR0(S_BEGUN),R1
            BZ      spectrum_window
            LDI     *+AR0(S_FILLED),R1
            LDI     *+AR0(S_SENT),R2
            STI     R1,*+AR0(S_SENT)
            STI     R2,*+AR0(S_FILLED)
            STI     R1,*+AR0(S_PIECE)
            LDI     SPECTRUM_PIECES,R1
            STI     R1,*+AR0(S_PIECES)
spectrum_window:
            CMPI    FFT_POINTS,R0
            RETSLT
            LDI     @window_end,R1
            LDI     R1,R2
            ANDN    RING-1,R2
            SUBI    4*FFT_POINTS,R1
            AND     RING-1,R1
            OR      R2,R1
            STI     R1,*+AR0(S_FIRST)
            LDI     *+AR0(S_NUMBER),R1
            ADDI    1,R1
            STI     R1,*+AR0(S_NUMBER)
            LDI     *+AR0(S_FILLED),R1
            STI     R1,*+AR0(S_PACKED)
            LDI     1,R1
            STI     R1,*+AR0(S_BEGUN)
            LDI     3,R1
            STI     R1,*+AR0(S_LEFT)
            RETS

; The tick: a piece goes behind the navigation frame, of what the frames leave of the line.
spectrum_send:
            LDI     spectrum_state,AR0
            LDI     *+AR0(S_PIECES),R0
            RETSZ
            LDI     4*PIECE_WORDS+8,R0
            CMPI    @credit,R0
            RETSGT
            CALL    spectrum_fits
            RETSGT
            LDI     *+AR0(S_PIECE),AR4
            LDI     SPECTRUM_TYPE,R4
            LDI     PIECE_WORDS,R5
            CALL    send_piece
            CMPI    0,R0
            RETSZ
            LDI     spectrum_state,AR0
            LDI     *+AR0(S_PIECE),R0
            ADDI    PIECE_WORDS,R0
            STI     R0,*+AR0(S_PIECE)
            LDI     *+AR0(S_PIECES),R0
            SUBI    1,R0
            STI     R0,*+AR0(S_PIECES)
            LDI     @credit,R0
            SUBI    4*PIECE_WORDS+8,R0
            STI     R0,@credit
            RETS

; The flags say "greater" where behind R0 more bytes the next navigation frame would not leave within its tick.
spectrum_fits:
            LDI     spectrum_places,AR1
            LSH     FRACTION_BITS,R0
            ADDI    @waiting,R0
            CMPI    *+AR1(4),R0
            RETS

            SENDER  send_piece

; The background: the next axis of the window, if one is left. The flags say at the end whether there are more.
spectrum:   LDI     spectrum_state,AR0
            LDI     *+AR0(S_LEFT),R0
            RETSZ
            LDI     *+AR0(S_FIRST),R1
            ADDI    3,R1
            SUBI    R0,R1                   ; x, y, z: 3, 2, 1 are left
            LDI     spectrum_places,AR1
            LDI     *+AR1(3),AR6
            LDI     R1,AR0
            CALL    fft

; Its pieces: number, time, axis with lost samples and first bin, amplitudes.
            LDI     spectrum_state,AR0
            LDI     spectrum_places,AR1
            LDI     *+AR1(3),AR2
            LDI     *+AR0(S_PACKED),AR1
            LDI     *+AR0(S_FIRST),AR3
            LDI     *+AR3(3),R1             ; the numbers of the first and the last sample
            LDI     4*FFT_POINTS-1,IR0
            NOP     *AR3++(IR0)%
            LDI     *AR3,R0
            SUBRI   R0,R1
            SUBI    FFT_POINTS-1,R1
            CMPI    255,R1
            LDIGT   255,R1
            LSH     8,R1
            LDI     3,R2
            SUBI    *+AR0(S_LEFT),R2
            OR      R1,R2
            LDI     *+AR0(S_NUMBER),R1
            LDI     16,R3
            LSH     16,R3
            LDI     FFT_PAIRS/16-1,AR4
spectrum_pack:
            STI     R1,*AR1++
            STI     R0,*AR1++
            STI     R2,*AR1++
            LDI     15,RC
            RPTB    spectrum_copy
            LDI     *AR2++,R4
spectrum_copy: STI  R4,*AR1++
            ADDI    R3,R2
            DB      AR4,spectrum_pack
            STI     AR1,*+AR0(S_PACKED)
            LDI     *+AR0(S_LEFT),R0
            SUBI    1,R0
            STI     R0,*+AR0(S_LEFT)
            RETS

spectrum_places: .word sample_ring, spectrum_sets, spectrum_sets+SPECTRUM_PIECES*PIECE_WORDS, fft_amplitudes
            .word   MOST_BEHIND
