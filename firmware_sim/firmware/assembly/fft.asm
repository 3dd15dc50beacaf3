; The spectrum of a gyro: nav/fft.py in assembly, every sum, product and rounding in the order of the kernel, so that
; both give the same bits (tests/firmware/test_fft_assembly.py).
;
; From AR0 on, every fourth word of a circular buffer of BK words: FFT_POINTS counts. To AR6: FFT_PAIRS amplitudes.
; Changes all registers but BK, DP and SP. fft_data lies at a multiple of FFT_POINTS, for the bit-reversed pointer.

            .sect   "services"
fft:        LDI     fft_places,AR7

; Two samples are a complex one, which goes to its bit-reversed place.
            LDI     *+AR7(0),AR2            ; the window
            LDI     *+AR7(2),AR1
            LDI     4,IR1
            LDI     FFT_PAIRS,IR0
            FLOAT   *AR0++(IR1)%,R0
            MPYF    *AR2++,R0
            FLOAT   *AR0++(IR1)%,R1
            MPYF    *AR2++,R1
            RND     R0,R2
            RND     R1,R3
            LDI     FFT_PAIRS-2,RC
            RPTB    fft_placed
            FLOAT   *AR0++(IR1)%,R0
            MPYF    *AR2++,R0
            FLOAT   *AR0++(IR1)%,R1
            MPYF    *AR2++,R1
            STF     R3,*+AR1(1)
||          STF     R2,*AR1++(IR0)B
            RND     R0,R2
fft_placed: RND     R1,R3
            STF     R3,*+AR1(1)
||          STF     R2,*AR1

; Stages one and two: of four complex numbers a, b, c, d, with AR0 at a and b, AR1 at c and d.
            LDI     *+AR7(2),AR0
            LDI     AR0,AR1
            ADDI    4,AR1
            LDI     2,IR0
            LDI     3,IR1
            LDI     FFT_PAIRS/4-1,RC
            RPTB    fft_four
            LDF     *AR0,R0
||          LDF     *+AR0(IR0),R1
            ADDF3   R1,R0,R2                ; real: a + b
            SUBF3   R1,R0,R3                ; a - b
            LDF     *AR1,R0
||          LDF     *+AR1(IR0),R1
            ADDF3   R1,R0,R4                ; c + d
            SUBF3   R1,R0,R5                ; c - d
            ADDF3   R4,R2,R0
            SUBF3   R4,R2,R1
            LDF     *+AR0(1),R2
||          LDF     *+AR0(IR1),R4
            RND     R0
            RND     R1
            STF     R0,*AR0++
||          STF     R1,*AR1++
            SUBF3   R4,R2,R7                ; imaginary: a - b
            ADDF3   R4,R2,R4                ; a + b
            LDF     *AR1,R0
||          LDF     *+AR1(IR0),R1
            ADDF3   R1,R0,R6                ; c + d
            SUBF3   R1,R0,R2                ; c - d
            ADDF3   R6,R4,R0
            SUBF3   R6,R4,R1
            RND     R0
            RND     R1
            STF     R0,*AR0++
||          STF     R1,*AR1++
            ADDF3   R2,R3,R0
            SUBF3   R2,R3,R1
            RND     R0
            RND     R1
            STF     R0,*AR0++
||          STF     R1,*AR1++
            SUBF3   R5,R7,R0
            ADDF3   R5,R7,R1
            RND     R0
            RND     R1
            STF     R0,*AR0
||          STF     R1,*AR1
            ADDI    5,AR0
fft_four:   ADDI    5,AR1

; The other stages: groups of butterflies of AR0 (above) and AR1 (below); AR3 goes through the twiddles, cosine and sine,
; in steps of IR1 words, AR4 counts groups. A butterfly's imaginary parts are stored in the next one, while the memory is
; free; the first of a group puts back what lies before it.
            LDI     2,IR0
            .eval   0, n
            .eval   4, size                 ; butterflies of a group
            .loop   FFT_STAGES
            LDI     *+AR7(2),AR0
            LDI     FFT_PAIRS/(2*size)-1,AR4
            LDI     2*FFT_PAIRS/size,IR1
            LDI     AR0,AR1
            ADDI    2*size,AR1
fft_group:n: LDI    *+AR7(1),AR3
            LDF     *-AR0(1),R2
||          LDF     *-AR1(1),R3
            LDI     size-1,RC
            RPTB    fft_butterfly:n:
            LDF     *+AR3(1),R5             ; sine
||          LDF     *AR3++(IR1),R4          ; cosine
            LDF     *AR1,R6
||          LDF     *+AR1(1),R7
            MPYF3   R6,R4,R0
||          STF     R2,*-AR0(1)
            MPYF3   R7,R5,R1
||          STF     R3,*-AR1(1)
            MPYF3   R7,R4,R0
||          ADDF3   R1,R0,R2                ; the real part of below, turned
            MPYF3   R6,R5,R1
            SUBF3   R1,R0,R3                ; its imaginary part
            LDF     *AR0,R4
||          LDF     *+AR0(1),R5
            ADDF3   R2,R4,R6
            SUBF3   R2,R4,R7
            RND     R6
            RND     R7
            STF     R6,*AR0++(IR0)
||          STF     R7,*AR1++(IR0)
            ADDF3   R3,R5,R2
            SUBF3   R3,R5,R3
            RND     R2
fft_butterfly:n:: RND  R3
            DBD     AR4,fft_group:n:
            STF     R2,*-AR0(1)
||          STF     R3,*-AR1(1)
            LDI     AR1,AR0                 ; the next group
            ADDI    2*size,AR1
            .eval   n+1, n
            .eval   2*size, size
            .endloop

; The transform of the real samples from that of the complex ones: AR0 goes up, AR1 down to the middle.
            LDI     *+AR7(2),AR0
            LDI     *+AR7(1),AR3
            LDI     AR0,AR1
            ADDI    FFT_POINTS-2,AR1
            LDI     2,IR0
            ADDF3   *+AR0(1),*AR0,R0
            LDF     *AR0,R1
            SUBF    *+AR0(1),R1
            ADDF    R0,R0
            ADDF    R1,R1
            RND     R0
            RND     R1
            STF     R1,*+AR0(1)
||          STF     R0,*AR0++(IR0)
            NOP     *AR3++(IR0)
            LDI     3,IR1
            LDF     *-AR0(1),R6             ; put back by the first, as above
||          LDF     *+AR1(IR1),R7
            LDI     FFT_PAIRS/2-1,RC
            RPTB    fft_split
            LDF     *AR0,R0
||          LDF     *+AR0(1),R1
            LDF     *AR1,R2
||          LDF     *+AR1(1),R3
            ADDF3   R3,R1,R4
            SUBF3   R0,R2,R5
            RND     R4                      ; odd part
            RND     R5
            STF     R6,*-AR0(1)
||          STF     R7,*+AR1(IR1)
            ADDF3   R2,R0,R6                ; even part
            SUBF3   R3,R1,R7
            LDF     *+AR3(1),R3
||          LDF     *AR3++(IR0),R2
            MPYF3   R4,R2,R0
            MPYF3   R5,R3,R1
            MPYF3   R5,R2,R0
||          ADDF3   R1,R0,R2
            MPYF3   R4,R3,R1
            SUBF3   R1,R0,R3
            ADDF3   R2,R6,R0
            SUBF3   R2,R6,R1
            RND     R0
            RND     R1
            STF     R0,*AR0++(IR0)
||          STF     R1,*AR1--(IR0)
            ADDF3   R3,R7,R6
            SUBF3   R7,R3,R7
            RND     R6
fft_split:  RND     R7
            STF     R6,*-AR0(1)
||          STF     R7,*+AR1(IR1)

; Magnitudes times the scale: Newton's steps to the root of the square, which is m 2^2h with m from 1 to 4.
            LDI     *+AR7(2),AR0
            LDI     *+AR7(3),AR2
            LDF     0.5,R4
            MPYF3   *AR2,R4,R0
            ABSF    *AR0++(IR0),R1
            MPYF3   R0,R1,R0
            RND     R0
            STF     R0,*AR6++
            LDI     FFT_PAIRS-2,RC
            RPTB    fft_root
            LDF     *+AR0(1),R1
||          LDF     *AR0++(IR0),R0
            MPYF3   R0,R0,R0
            MPYF3   R1,R1,R1
            ADDF3   R1,R0,R2
            RND     R2
            LDF     R2,R0
            PUSHF   R2
            POP     R5
            LDF     1.0,R6
            ASH     -25,R5                  ; h; an odd exponent leaves C
            LDFC    2.0,R6
            LDE     R6,R0                   ; m
            LSH     24,R5
            PUSH    R5
            MPYF3   R4,R0,R6                ; m / 2
            MPYF3   *+AR2(1),R0,R1
            ADDF    *+AR2(2),R1
            MPYF3   R1,R0,R1
            ADDF    *+AR2(3),R1
            MPYF3   R1,R0,R1
            ADDF    *+AR2(4),R1
            RND     R1                      ; y, near 1 / root of m
            MPYF3   R1,R6,R7
            MPYF3   R1,R7,R7
            SUBRF   0.5,R7
            MPYF3   R7,R1,R7
            ADDF3   R7,R1,R3
            RND     R3
            MPYF3   R3,R6,R1
            MPYF3   R3,R1,R1
            SUBRF   0.5,R1
            MPYF3   R1,R3,R1
            ADDF3   R1,R3,R3
            RND     R3
            MPYF3   R3,R0,R1
            RND     R1                      ; root
            MPYF3   R1,R1,R6
            SUBF3   R6,R0,R0
            MPYF3   R4,R3,R3
            MPYF3   R3,R0,R0
            ADDF3   R0,R1,R3
            RND     R3
            POPF    R5                      ; 2^h
            MPYF3   R5,R3,R0
            CMPF    0.0,R2
            LDFLE   0.0,R0
            MPYF    *AR2,R0
            RND     R0
fft_root:   STF     R0,*AR6++
            RETS

fft_places: .word   fft_window, fft_twiddles, fft_data, fft_numbers
