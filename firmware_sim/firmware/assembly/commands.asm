; Commands from the host (docs/interface-control.md): the background receives them, the tick obeys.

            .sect   "services"
; Read what has come, up to a whole command; then that waits for the tick.
receive:    LDI     @rx_head,AR0
            CMPI    @rx_tail,AR0
            BEQ     receive_end
            LDI     @is_ready,R0
            BNZ     receive_end
            LDI     *AR0++(1)%,R1
            STI     AR0,@rx_head
            LDI     @received,R0
            CMPI    1,R0
            BLT     receive_first
            BEQ     receive_second

; Behind the start bytes: type, length, payload, CRC.
            LDI     @command_at,AR1
            LDI     R0,IR0
            SUBI    2,IR0
            ADDI    1,R0
            STI     R0,@received
            STI     R1,*+AR1(IR0)
            CMPI    4,R0
            BLT     receive
            LDI     *+AR1(1),R1
            ADDI    8,R1
            CMPI    R1,R0
            BLT     receive
            CALL    check
            LDI     0,R1
            STI     R1,@received
            CMPI    0,R0
            BEQ     receive_good
            LDI     @bad_commands,R0
            ADDI    1,R0
            STI     R0,@bad_commands
            B       receive
receive_good:
            LDI     1,R0
            STI     R0,@is_ready
receive_end: RETS

receive_first:
            LDI     0,R0
            CMPI    0EBh,R1
            LDIEQ   1,R0
            STI     R0,@received
            B       receive
receive_second:
            LDI     0,R0
            CMPI    0EBh,R1
            LDIEQ   1,R0
            CMPI    90h,R1
            LDIEQ   2,R0
            STI     R0,@received
            B       receive

; R0 is 0 when the CRC of the command is right. Over type, length, payload and CRC it leaves a known remainder.
check:      LDI     @command_at,AR1
            LDI     @crc_at,AR3
            LDI     *+AR1(1),RC
            ADDI    5,RC
            LDI     -1,R0
            LDI     0FFh,R2
            RPTB    check_byte
            XOR3    R0,*AR1++,R1
            AND3    R2,R1,IR0
            LSH     -8,R0
            NOP
check_byte: XOR     *+AR3(IR0),R0
            XOR     @crc_residue,R0
            RETS

; The tick obeys a command and answers: 0 for done, else what was wrong.
obey:       LDI     0,R0
            STI     R0,@is_ready
            LDI     @command_at,AR1
            LDI     *AR1++,R0               ; type
            LDI     *AR1++,R1               ; length; AR1 is at the payload
            STI     R0,@answer+1
            CMPI    START_COMMAND,R0
            BEQ     obey_start
            CMPI    MODE_COMMAND,R0
            BEQ     obey_mode
            CMPI    SCALE_COMMAND,R0
            BEQ     obey_scale
            LDI     UNKNOWN_COMMAND,R0
            B       obey_answer

; Eight numbers: latitude, longitude, velocity, attitude.
obey_start: CMPI    32,R1
            BNE     obey_length
            .loop   8
            CALL    word
            PUSH    R0
            .endloop
            POP     R7
            POP     R6
            POP     R5
            POP     R4
            POP     R3
            POP     R2
            POP     R1
            POP     R0
            CALL    START
            CMPI    0,R0
            BNE     obey_answer
            LDI     NAVIGATE,R1
            STI     R1,@mode
            STI     R1,@next_mode
            STI     R1,@has_start
            B       obey_answer

obey_mode:  CMPI    4,R1
            BNE     obey_length
            CALL    word
            CMPI    0,R0
            BEQ     obey_set
            LDI     @has_start,R1           ; nothing to begin from
            BZ      obey_range
            CMPI    NAVIGATE,R0
            BEQ     obey_set
            .if     ALIGNS
            CMPI    COARSE,R0
            BNE     obey_range
            CALL    align
            LDI     0,R0
            B       obey_answer
            .else
            B       obey_range
            .endif
obey_set:   STI     R0,@mode
            STI     R0,@next_mode
            LDI     0,R0
            B       obey_answer

; Six singles: the weights of the counts and the sample period, in two words each.
obey_scale: CMPI    24,R1
            BNE     obey_length
            LDI     @new_scale_at,AR2
            LDI     5,AR3
scale_word: CALL    word
            STI     R0,*AR2++
            DB      AR3,scale_word
            CALL    k_start_accept_scale
            B       obey_answer

obey_length: LDI    WRONG_LENGTH,R0
            B       obey_answer
obey_range: LDI     1,R0
obey_answer:
            LDI     @bad_commands,R1
            LSH     8,R1                    ; the type, the code, and how many were damaged
            OR      R1,R0
            LSH     8,R0
            OR      @answer+1,R0
            STI     R0,@answer+1
            LDI     @answer,R0
            ADDI    1,R0
            STI     R0,@answer
            LDI     1,R0
            STI     R0,@has_answer
            RETS

; Four bytes from AR1 on, the lowest first, to R0.
word:       ADDI    4,AR1
            LDI     *-AR1(1),R0
            .eval   2, n
            .loop   3
            LSH     8,R0
            OR      *-AR1(n),R0
            .eval   n+1, n
            .endloop
            RETS
