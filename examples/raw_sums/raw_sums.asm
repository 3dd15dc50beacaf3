; Raw channel sums as described frames: the first program for the board (docs/first-program.md).
;
; INT0 adds the six channels of each sample, TIMER0 takes the sums every 20 ms, the background loop packs them into a
; frame, and INT1 feeds the UART. Everything that is addressed directly is in page 0, so DP stays 0.

ADC         .set    810000h
UART        .set    814000h
TIMER0      .set    808020h

PERIOD      .set    250000          ; 20 ms of H1/2
TIMER_RUNS  .set    2C1h            ; internal clock, pulse mode, GO
DIVISOR     .set    1               ; 1.8432 MHz / 16 / 115200
SOURCES     .set    103h            ; IE: INT0, INT1, TINT0
RUNNING     .set    6800h           ; ST: edge triggered, GIE, cache
TABLE_PAGE  .set    1               ; ITTP: the table of vectors is at 100h

FRAME_TYPE  .set    2
FIELDS      .set    9               ; words of a frame, and described fields
RING_MASK   .set    3FFh            ; 1024 bytes
RING_FULL   .set    RING_MASK-300   ; no frame is longer than 263 bytes
DESCRIBE    .set    5               ; one description in so many ticks: each comes about once a second

            .asect  "reset",0
            .word   start

            .asect  "table",100h
            .word   0, samples, line, 0, 0, 0, 0, 0, 0, tick, 0, 0, 0

            .asect  "program",200h

; ---- start ------------------------------------------------------------------------------------------------------

start:      LDI     0,DP
            LDI     @stack,SP
            LDI     TABLE_PAGE,R0
            LSH     16,R0
            LDI     R0,IF           ; ITTP, and no interrupt waits
            CALL    make_crc_table
            LDI     @uart,AR0
            LDI     83h,R0          ; 8N1, and the divisor latch
            STI     R0,*+AR0(3)
            LDI     DIVISOR,R0
            STI     R0,*AR0
            LDI     0,R0
            STI     R0,*+AR0(1)
            LDI     3,R0
            STI     R0,*+AR0(3)
            LDI     7,R0            ; FIFO mode, both FIFOs empty
            STI     R0,*+AR0(2)
            LDI     @timer,AR0
            LDI     @period,R0
            STI     R0,*+AR0(8)
            LDI     TIMER_RUNS,R0
            STI     R0,*AR0
            LDI     SOURCES,IE
            OR      RUNNING,ST

; ---- background -------------------------------------------------------------------------------------------------

; A tick that comes just before IDLE is seen after the next sample, 1 ms later.
background: IDLE
            LDI     @ticked,R0
            BZ      background
            LDI     0,R0
            STI     R0,@ticked
            CALL    pack
            LDI     @payload_at,AR4
            LDI     FRAME_TYPE,R4
            LDI     4*FIELDS,R5
            CALL    send
            LDI     @until_next,R0
            SUBI    1,R0
            BNZ     counted
            CALL    describe
            LDI     DESCRIBE,R0
counted:    STI     R0,@until_next
            LDI     @uart,AR0
            LDI     2,R0            ; let the transmitter ask for bytes
            STI     R0,*+AR0(1)
            B       background

; Each word of the frame as four bytes, the lowest first.
pack:       LDI     @taken_at,AR2
            LDI     @payload_at,AR3
            LDI     FIELDS-1,AR5
pack_word:  LDI     *AR2++,R0
            .loop   4
            LDI     R0,R1
            AND     0FFh,R1
            STI     R1,*AR3++
            LSH     -8,R0
            .endloop
            DB      AR5,pack_word
            RETS

; The next description: a length and as many bytes; the last one is followed by a length of 0.
describe:   LDI     @description,AR4
            LDI     *AR4++,R5
            BNZ     described
            LDI     @first,AR4
            LDI     *AR4++,R5
described:  LDI     0,R4
            CALL    send
            STI     AR4,@description
            RETS

; The frame of type R4 with R5 bytes from AR4 on goes to the ring, or nowhere if the ring is full. AR4 is moved on.
send:       LDI     @tail,R0
            SUBI    @head,R0
            AND     RING_MASK,R0
            CMPI    RING_FULL,R0
            BGT     dropped
            LDI     0EBh,R0
            CALL    put
            LDI     90h,R0
            CALL    put
            LDI     -1,R7           ; the CRC begins after the start bytes
            LDI     R4,R0
            CALL    put
            LDI     R5,R0
            CALL    put
            LDI     R5,AR5
            SUBI    1,AR5
send_byte:  LDI     *AR4++,R0
            CALL    put
            DB      AR5,send_byte
            NOT     R7,R6
            .loop   4
            LDI     R6,R0
            AND     0FFh,R0
            CALL    put
            LSH     -8,R6
            .endloop
            RETS
dropped:    ADDI    R5,AR4
            RETS

; The byte in R0 goes to the ring and into the CRC in R7.
put:        LDI     @ring_at,AR0
            LDI     @tail,IR0
            STI     R0,*+AR0(IR0)
            ADDI    1,IR0
            AND     RING_MASK,IR0
            STI     IR0,@tail
            XOR     R7,R0,IR0
            AND     0FFh,IR0
            LDI     @crc_at,AR0
            LSH     -8,R7
            XOR     *+AR0(IR0),R7
            RETS

; The 256 words of the CRC-32 of single bytes, reflected polynomial.
make_crc_table:
            LDI     @crc_at,AR0
            LDI     0,R1
crc_entry:  LDI     R1,R0
            .loop   8
            LSH     -1,R0
            BNC     $+2             ; the bit that fell out decides
            XOR     @polynomial,R0
            .endloop
            STI     R0,*AR0++
            ADDI    1,R1
            CMPI    100h,R1
            BLT     crc_entry
            RETS

; ---- services ---------------------------------------------------------------------------------------------------

; INT0: a conversion has ended. Reading the last channel frees the latches.
samples:    PUSH    ST
            PUSH    R0
            PUSH    AR0
            PUSH    AR1
            LDI     @adc,AR0
            LDI     @sums_at,AR1
            LDI     *+AR0(7),R0
            STI     R0,@number
            LDI     @count,R0
            ADDI    1,R0
            STI     R0,@count
            .loop   6
            LDI     *++AR0,R0
            ADDI    *AR1,R0
            STI     R0,*AR1++
            .endloop
            POP     AR1
            POP     AR0
            POP     R0
            POP     ST
            RETI

; TINT0: take the sums and clear them. No sample can come between, because GIE is clear in a service.
tick:       PUSH    ST
            PUSH    R0
            PUSH    R1
            PUSH    AR0
            PUSH    AR1
            LDI     @sequence,R0
            ADDI    1,R0
            STI     R0,@sequence
            LDI     @number_at,AR0
            LDI     @taken_at,AR1
            STI     R0,*AR1++
            LDI     *AR0++,R0       ; number of the last sample
            STI     R0,*AR1++
            LDI     0,R1
            .loop   7               ; count of samples and six sums
            LDI     *AR0,R0
            STI     R1,*AR0++
            STI     R0,*AR1++
            .endloop
            LDI     1,R0
            STI     R0,@ticked
            POP     AR1
            POP     AR0
            POP     R1
            POP     R0
            POP     ST
            RETI

; INT1: the transmitter is empty. Up to 16 bytes go from the ring to its FIFO; an empty ring switches it off.
line:       PUSH    ST
            PUSH    R0
            PUSH    R1
            PUSH    AR0
            PUSH    AR1
            PUSH    IR0
            LDI     @uart,AR0
            LDI     @ring_at,AR1
line_more:  LDI     *+AR0(2),R0     ; an edge requests INT1, so nothing may be left pending
            TSTB    1,R0
            BNZ     line_end
            LDI     @head,IR0
            LDI     16,R1
            CMPI    @tail,IR0
            BEQ     line_off
fill:       LDI     *+AR1(IR0),R0
            STI     R0,*AR0
            ADDI    1,IR0
            AND     RING_MASK,IR0
            CMPI    @tail,IR0
            BEQ     filled
            SUBI    1,R1
            BNZ     fill
filled:     STI     IR0,@head
            B       line_more
line_off:   LDI     0,R0
            STI     R0,*+AR0(1)
            B       line_more
line_end:   POP     IR0
            POP     AR1
            POP     AR0
            POP     R1
            POP     R0
            POP     ST
            RETI

; ---- data -------------------------------------------------------------------------------------------------------

            .asect  "data",1000h
stack:      .word   87FE00h         ; on-chip RAM
adc:        .word   ADC
uart:       .word   UART
timer:      .word   TIMER0
period:     .word   PERIOD
polynomial: .word   0EDB88320h
ring_at:    .word   ring
crc_at:     .word   crc_table
taken_at:   .word   taken
payload_at: .word   payload
number_at:  .word   number
sums_at:    .word   sums
first:      .word   descriptions
description: .word  descriptions
until_next: .word   1
ticked:     .word   0
head:       .word   0               ; of the ring: the next byte to send, and the next free place
tail:       .word   0
sequence:   .word   -1

number:     .word   0               ; these eight are taken together
count:      .word   0
sums:       .space  6

taken:      .space  FIELDS
payload:    .space  4*FIELDS
crc_table:  .space  100h
ring:       .space  RING_MASK+1

            .include "descriptions.asm"
