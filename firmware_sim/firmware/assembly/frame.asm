; Frames: the navigation frame is completed, packed byte by byte with its CRC, and handed to the UART's ring.

            .sect   "services"
report:     LDI     @timer1_at,AR0
            LDI     *+AR0(4),R0
            SUBI    @due,R0
            CALL    whole_ticks             ; ticks that have come meanwhile
            LDI     0,R6
            ADDI    @frame+OVERRUNS_WORD,R1
            CMPI    @frame+OVERRUNS_WORD,R1
            LDINE   OVERRUN_FLAG,R6
            STI     R1,@frame+OVERRUNS_WORD
            OR      @sample_bits,R6
            OR      @solution,R6
            OR      @extra_flags,R6
            LDI     0,R1
            LDI     @is_dropped,R0
            LDINZ   DROPPED_FLAG,R1
            OR      R1,R6
            LSH     8,R6                    ; flags, samples, mode: one word
            LDI     @taken,R0
            CMPI    255,R0
            LDIGT   255,R0
            OR      R0,R6
            LSH     8,R6
            OR      @mode,R6
            STI     R6,@frame+FLAGS_WORD
            LDI     0,R0                    ; the watchdog's bite is told once
            STI     R0,@extra_flags

            LDI     @frame_at,AR1           ; attitude and velocity
            .eval   0, n
            .loop   5
            LDI     @v_angles_rad+n,R0
            STI     R0,@frame+ATTITUDE_WORD+n
            .eval   n+1, n
            .endloop
            .eval   0, n
            .loop   3
            LDI     @v_velocity_t_mps+n,R0
            STI     R0,@frame+VELOCITY_WORD+n
            .eval   n+1, n
            .endloop
            LDI     @solver_at,AR2          ; the increments of both halves
            ADDI    SUMS_WORD,AR1
            .loop   6
            LDI     *AR2++,R0
            ADDI    *+AR2(5),R0
            STI     R0,*AR1++
            .endloop

            .if     SPECTRUM
            CALL    spectrum_tick
            .endif

; Descriptions use what the line has left over; one that is late goes before the frame.
            LDI     @due_words,R0
            ADDI    DESCRIPTIONS,R0
            CMPI    2*DESCRIBE_TICKS,R0
            LDIGT   2*DESCRIBE_TICKS,R0
            STI     R0,@due_words
            LDI     @credit,R1
            ADDI    SPARE_BYTES,R1
            CMPI    MOST_CREDIT,R1
            LDIGT   MOST_CREDIT,R1
            CMPI    -MOST_CREDIT,R1
            LDILT   -MOST_CREDIT,R1
            STI     R1,@credit
            LDI     @waited,R0
            ADDI    1,R0
            STI     R0,@waited
            CMPI    LATE_TICKS,R0
            BLT     report_frame
            CALL    describe
            BZ      report_dropped
            CALL    send_navigation
            B       report_events
report_dropped:
            LDI     1,R0                    ; where it found no room, the frame must not take that
            CALL    navigation_told
            B       report_events
report_frame:
            CALL    send_navigation
            .if     SPECTRUM
            CALL    spectrum_send
            .endif
            LDI     @due_words,R0
            CMPI    DESCRIBE_TICKS,R0
            BLT     report_events
            LDI     @described,AR4
            LDI     *AR4,R0
            CMPI    @credit,R0
            BGT     report_events
            .if     SPECTRUM
            CALL    spectrum_fits
            BGT     report_events
            .endif
            CALL    describe

; Beside them one short frame a tick: an event, or the answer to a command.
report_events:
            LDI     @event,R0
            CMPI    @event_sent,R0
            BEQ     report_answer
            STI     R0,@event_sent
            LDI     @event_at,AR4
            LDI     EVENT_TYPE,R4
            B       report_notice
report_answer:
            LDI     @has_answer,R0
            BZ      report_end
            LDI     0,R0
            STI     R0,@has_answer
            LDI     @answer_at,AR4
            LDI     ANSWER_TYPE,R4
report_notice:
            LDI     2,R5
            CALL    notify
report_end: LDI     @uart_at,AR0
            LDI     3,R0                    ; let the transmitter ask for bytes
            STI     R0,*+AR0(1)
            RETS

send_navigation:
            LDI     @frame_at,AR4
            LDI     NAVIGATION_TYPE,R4
            LDI     FRAME_WORDS,R5
            CALL    send
            XOR     1,R0
navigation_told:
            STI     R0,@is_dropped
            LDI     @frame,R0               ; the sequence counts frames that were dropped too
            ADDI    1,R0
            STI     R0,@frame
            RETS

; The next description goes to the ring, if there is room: a length, and as many bytes. A length of 0 ends the list.
; R0, and the flags, are 0 where there was none.
describe:   LDI     @described,AR4
            LDI     *AR4++,R5
            CALL    claim
            BGT     describe_none
            LDI     @tx_tail,AR2
            LDI     R5,RC
            SUBI    2,RC
            LDI     *AR4++,R0
            RPTB    describe_byte
describe_byte: LDI  *AR4++,R0
||          STI     R0,*AR2++(1)%
            STI     R0,*AR2++(1)%
            STI     AR2,@tx_tail
            LDI     @credit,R0
            SUBI    R5,R0
            STI     R0,@credit
            LDI     @due_words,R0
            SUBI    DESCRIBE_TICKS,R0
            LDILT   0,R0
            STI     R0,@due_words
            LDI     0,R0
            STI     R0,@waited
            LDI     *AR4,R0
            BNZ     describe_next
            LDI     @first_at,AR4
describe_next:
            STI     AR4,@described
            LDI     1,R0
            RETS
describe_none:
            LDI     0,R0
            RETS

; R5 more bytes go into the account of what waits for the line (see transmit_account.py), if it admits them: the flags
; say "greater" where it does not.
claim:      LDI     R5,R0
            LSH     FRACTION_BITS,R0
            ADDI    @waiting,R0
            CMPI    @most_waiting,R0
            RETSGT
            STI     R0,@waiting
            RETS

; One byte, the low one of R1, to the ring and into the CRC in R7; R6 is 0FFh.
BYTE        .macro
            AND3    R6,R1,R0
            STI     R0,*AR2++(1)%
            XOR3    R7,R0,R0
            AND3    R6,R0,IR0
            LSH     -8,R1
            LSH     -8,R7
            XOR     *+AR3(IR0),R7
            .endm

; A routine that sends the frame of type R4 with R5 words from AR4 on. R0 is 1 when it went to the ring, and 0 when
; there was no room.
SENDER      .macro  name
:name:      LSH     2,R5                    ; in bytes
            ADDI    8,R5
            CALL    claim
            BGT     dropped?
            LDI     @tx_tail,AR2
            LDI     @crc_at,AR3
            SUBI    8,R5
            LDI     0EBh,R0
            STI     R0,*AR2++(1)%
            LDI     90h,R0
            STI     R0,*AR2++(1)%
            LDI     -1,R7
            LDI     0FFh,R6
            LDI     R5,R1                   ; type and length
            LSH     8,R1
            OR      R4,R1
            BYTE
            BYTE
            LSH     -2,R5
            LDI     R5,RC
            SUBI    1,RC
            RPTB    :name:_word
            LDI     *AR4++,R1
            BYTE
            BYTE
            BYTE
            AND3    R6,R1,R0
            STI     R0,*AR2++(1)%
            XOR3    R7,R0,R0
            AND3    R6,R0,IR0
            LSH     -8,R7
            NOP
:name:_word: XOR    *+AR3(IR0),R7
            NOT     R7,R1
            .loop   4
            AND3    R6,R1,R0
            STI     R0,*AR2++(1)%
            LSH     -8,R1
            .endloop
            STI     AR2,@tx_tail
            LDI     1,R0
            RETS
dropped?:   LDI     0,R0
            RETS
            .endm

            SENDER  send                    ; the navigation frame
            SENDER  notify                  ; short ones
