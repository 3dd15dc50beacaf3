; TINT0: one navigation cycle. The sums are taken, then all other services may come in between.

SAVE        .macro
            PUSH    ST
            .eval   0, n
            .loop   8
            PUSH    R:n:
            PUSHF   R:n:
            .eval   n+1, n
            .endloop
            .eval   0, n
            .loop   8
            PUSH    AR:n:
            .eval   n+1, n
            .endloop
            PUSH    IR0
            PUSH    IR1
            PUSH    RS
            PUSH    RE
            PUSH    RC
            .endm

RESTORE     .macro
            POP     RC
            POP     RE
            POP     RS
            POP     IR1
            POP     IR0
            .eval   7, n
            .loop   8
            POP     AR:n:
            .eval   n-1, n
            .endloop
            .eval   7, n
            .loop   8
            POPF    R:n:
            POP     R:n:
            .eval   n-1, n
            .endloop
            POP     ST
            .endm

; The watchdog at AR1 is content for another 100 ms.
FEED        .macro
            LDI     5Ah,R0
            STI     R0,*AR1
            LDI     0A5h,R0
            STI     R0,*AR1
            .endm

            .sect   "services"
tick_service:
            SAVE
            LDI     @timer1_at,AR0
            LDI     @sums_at,AR1
            LDI     @solver_at,AR2
            LDI     0,R1
            LDI     *+AR0(4),R0
            STI     R0,@began

; The latch rule: no sample comes between, for a service begins with interrupts off.
            LDI     11,RC
            RPTB    tick_latch
            LDI     *AR1,R0
tick_latch: STI     R0,*AR2++
||          STI     R1,*AR1++
            .if     SPECTRUM
            LDI     @sample_at,R0
            STI     R0,@window_end
            .endif
            LDI     @samples,R2
            STI     R1,@samples
            STI     R2,@taken
            LDI     @adc_status,R0
            STI     R1,@adc_status
            STI     R0,@taken_status
            LDI     @height_mm,R0
            STI     R0,@taken_height
            LDI     @climb_mmps,R0
            STI     R0,@taken_climb
            LDI     @number,R0
            STI     R0,@frame+VALID_WORD
            LDI     @lost,R3
            ANDN    TICK_SOURCE,IE
            OR      2000h,ST

; Flags of the samples: lost since the last frame, saturated, faulty, none at all.
            LDI     0,R7
            CMPI    @frame+LOST_WORD,R3
            LDINE   LOST_FLAG,R7
            STI     R3,@frame+LOST_WORD
            CALL    sample_flags

; Which tick this is; those that were missed are passed over.
            LDI     @began,R0
            SUBI    @due,R0
            CALL    whole_ticks
            LDI     @drained,R2             ; what the line has taken since the last one
            CMPI    0,R1
            LDIZ    0,R2                    ; a failing supply calls this service between two ticks
            SUBRI   @waiting,R2
            LDILT   0,R2
            STI     R2,@waiting
            ADDI    @tick,R1
            STI     R1,@tick
            STI     R1,@frame+TICK_WORD
            LDI     @began,R1
            SUBI    R0,R1
            STI     R1,@due

            LDI     0,R0
            STI     R0,@solution
            LDI     @taken,R0
            LDI     R0,R1
            SUBI    @first_part,R1
            LDILT   0,R1                    ; samples of the second half
            SUBI    R1,R0
            LDI     @taken_height,R2
            LDI     @mode,R3
            BZ      tick_report
            CMPI    NAVIGATE,R3
            BEQ     tick_navigate
            .if     ALIGNS
            CALL    k_alignment_cycle_align_cycle
            STI     R4,@next_mode
            B       tick_solved
            .endif
tick_navigate:
            LDI     @taken_climb,R3
            CALL    SOLVE                   ; the kernel navigate of the board's mechanisation
tick_solved:
            STI     R0,@solution
            STF     R1,@frame+HEIGHT_WORD
            STI     R2,@frame+LATITUDE_WORD
            STI     R3,@frame+LONGITUDE_WORD
            EXTRA                           ; a kernel of the user's, if there is one

tick_report:
            CALL    report
            LDI     @next_mode,R0
            STI     R0,@mode
            LDI     @timer1_at,AR0
            LDI     @watchdog_at,AR1
            LDI     *+AR0(4),R0
            SUBI    @began,R0
            LSH     1,R0                    ; the stopwatch counts every second cycle
            STI     R0,@frame+SOLVER_WORD   ; for the next frame
            FEED
            LDI     @received,R1            ; half a command that does not go on is forgotten
            LDI     @rx_tail,R0
            CMPI    @rx_seen,R0
            LDIEQ   0,R1
            STI     R1,@received
            STI     R0,@rx_seen
            LDI     @is_ready,R0
            BZ      tick_end
tick_obeys: CALL    obey
tick_end:   ANDN    2000h,ST
            OR      TICK_SOURCE,IE
            RESTORE
            RETI

            .if     WATCHES
; Ticks come too seldom for the watchdog: behind every interrupt the background feeds it as well, but not when a tick is
; overdue; and the background waits for a service that hangs.
watch:      LDI     @timer1_at,AR0
            LDI     @watchdog_at,AR1
            LDI     *+AR0(4),R0
            SUBI    @due,R0
            SUBI    @period,R0
            CMPI    OVERDUE,R0
            BGT     watch_end
            FEED
watch_end:  RETS
            .endif

            .if     ALIGNS
; The coarse stage begins at the place of now.
align:      LDI     @align_half,R0
            LDI     @align_coarse,R1
            LDI     @align_end,R2
            LDI     @align_update,R3
            LDF     @align_variance,R4
            CALL    k_alignment_begin_alignment
            LDI     COARSE,R0
            STI     R0,@mode
            STI     R0,@next_mode
            RETS
            .endif

; R7 gets the flags that the status of the samples raises.
sample_flags:
            LDI     @taken_status,R0
            LDI     0,R1
            TSTB    SATURATED,R0
            LDINZ   SATURATED_FLAG,R1
            OR      R1,R7
            LDI     0,R1
            TSTB    FAULTS,R0
            LDINZ   FAULT_FLAG,R1
            OR      R1,R7
            LDI     0,R1
            LDI     @taken,R0
            LDIZ    EMPTY_FLAG,R1
            OR      R1,R7
            STI     R7,@sample_bits
            RETS

; R0, counts of the stopwatch, into whole ticks R1 and the rest R0.
whole_ticks:
            LDI     0,R1
            LDI     @period,R2
whole_more: CMPI    R2,R0
            BLT     whole_end
            SUBI    R2,R0
            ADDI    1,R1
            B       whole_more
whole_end:  RETS
