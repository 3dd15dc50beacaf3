; From reset to the background loop. Constants of the boot itself are in page 0.

            .sect   "boot"
boot:       LDI     0,DP
            LDI     @boot_timer1,AR0        ; the stopwatch first: it counts from here
            LDI     -1,R0
            STI     R0,*+AR0(8)
            LDI     TIMER_RUNS,R0
            STI     R0,*AR0
            LDI     @boot_stack,SP
            LDI     @boot_strobes,AR1       ; two wait states for the devices at IOSTRB
            LDI     @boot_iostrb,R0
            STI     R0,*AR1
            LDI     RING,BK                 ; for both rings
            LDI     VECTOR_PAGE,R0          ; ITTP, and no interrupt waits
            LSH     16,R0
            LDI     R0,IF

; Memory: all of the on-chip RAM is cleared, then the constants are copied there.
            LDI     @boot_onchip,AR1
            LDI     0,R0
            LDI     511,RC
            RPTB    boot_clear
boot_clear: STI     R0,*AR1++
            LDI     @boot_onchip,AR1        ; a float is 0 in other bits than an integer
            LDF     0.0,R0
            LDI     KERNEL_CONSTANTS_AT-ONCHIP-1,RC
            RPTB    boot_zero
boot_zero:  STF     R0,*AR1++
            LDI     @boot_kernels,AR1
            LDI     @boot_kernels_to,AR2
            LDI     @boot_kernels_count,RC
            RPTB    boot_copy1
            LDI     *AR1++,R0
boot_copy1: STI     R0,*AR2++
            LDI     @boot_constants,AR1
            LDI     @boot_constants_to,AR2
            LDI     CONSTANTS-1,RC
            RPTB    boot_copy2
            LDI     *AR1++,R0
boot_copy2: STI     R0,*AR2++
            LDI     @boot_scale,AR1
            LDI     @boot_scale_to,AR2
            LDI     @boot_built_to,AR3
            LDI     5,RC
            RPTB    boot_copy3
            LDI     *AR1++,R0
            STI     R0,*AR2++
boot_copy3: STI     R0,*AR3++
            LDI     CALIBRATION-1,RC
            RPTB    boot_unit
            LDI     *AR1++,R0
boot_unit:  STI     R0,*AR2++

            LDI     DATA_PAGE,DP
            LDI     @period,R0
            STI     R0,@frame+DEADLINE_WORD
            LDF     0.0,R0
            STF     R0,@frame+HEIGHT_WORD

; A watchdog that has bitten says so, once.
            LDI     @watchdog_at,AR1
            LDI     1,R1
            LDI     *AR1,R0
            LDINZ   WATCHDOG_FLAG,R0
            STI     R0,@extra_flags
            STI     R1,*AR1

; Start from the parameters, where they hold a start.
            LDI     0,DP
            LDI     @start_is_known,R0
            BZ      boot_uart
            LDI     @boot_start,AR1
            LDI     @boot_place,AR2
            LDI     3,RC
            RPTB    boot_copy4
            LDI     *AR1++,R0
boot_copy4: STI     R0,*AR2++
            LDI     @boot_velocity,AR2
            LDI     2,RC
            RPTB    boot_copy5
            LDI     *AR1++,R0
boot_copy5: STI     R0,*AR2++
            LDI     @boot_attitude,AR2
            LDI     2,RC
            RPTB    boot_copy6
            LDI     *AR1++,R0
boot_copy6: STI     R0,*AR2++
            LDI     @boot_attitude_low,AR2
            LDI     2,RC
            RPTB    boot_copy7
            LDI     *AR1++,R0
boot_copy7: STI     R0,*AR2++
            LDI     DATA_PAGE,DP
            CALL    INITIALISE
            LDI     1,R0
            STI     R0,@has_start
            .if     ALIGNS
            CALL    align
            .else
            LDI     NAVIGATE,R0
            STI     R0,@mode
            STI     R0,@next_mode
            .endif

; The line: 8N1, FIFOs on and empty, receiver on.
boot_uart:  LDI     DATA_PAGE,DP
            LDI     @uart_at,AR0
            LDI     83h,R0
            STI     R0,*+AR0(3)
            LDI     DIVISOR&0FFh,R0
            STI     R0,*AR0
            LDI     DIVISOR>>8,R0
            STI     R0,*+AR0(1)
            LDI     3,R0
            STI     R0,*+AR0(3)
            LDI     7,R0
            STI     R0,*+AR0(2)
            LDI     1,R0
            STI     R0,*+AR0(1)

; The tick: its timer goes on from where it would be, had it been started at reset.
            LDI     @timer0_at,AR0
            LDI     @timer1_at,AR1
            LDI     @period,R0
            STI     R0,*+AR0(8)
            LDI     TIMER_RUNS,R0
            STI     R0,*AR0
            LDI     *+AR1(4),R1
            ADDI    FROM_RESET_TO_TICK,R1
            STI     R1,*+AR0(4)
            LDI     -FROM_RESET,R0          ; the stopwatch where it would have been 0 at reset
            STI     R0,@due

            .if     SPECTRUM
            CALL    spectrum_boot
            .endif
            LDI     SOURCES,IE
            OR      RUNNING,ST

; The background: commands from the host; with long ticks the watchdog; spectra.
background: IDLE
            .if     SPECTRUM
background_goes_on:
            .endif
            CALL    receive
            .if     WATCHES
            CALL    watch
            .endif
            .if     SPECTRUM
            CALL    spectrum
            BNZ     background_goes_on
            .endif
            B       background

boot_timer1: .word  TIMER1
boot_stack: .word   stack-1
boot_strobes: .word STROBES
boot_iostrb: .word  IOSTRB
boot_onchip: .word  ONCHIP
boot_kernels: .word kernel_constants
boot_kernels_to: .word KERNEL_CONSTANTS_AT
boot_kernels_count: .word KERNEL_CONSTANTS-1
boot_constants: .word constants
boot_constants_to: .word adc_at
boot_scale: .word   scale_words
boot_scale_to: .word v_scale
boot_built_to: .word v_built_scale
boot_start: .word   start_words
boot_place: .word   v_place
boot_velocity: .word v_velocity_t_mps
boot_attitude: .word v_attitude_rad
boot_attitude_low: .word v_attitude_low_rad

; What boot copies on chip.
constants:  .word   ADC, UART, TIMER0, TIMER1, WATCHDOG
            .word   sums, sums+6, v_sums, frame, event, answer, crc_table, command
            .word   tx_ring, tx_ring, rx_ring, rx_ring, descriptions, descriptions, v_new_scale
            .word   PERIOD, FIRST_PART, SAFE_COUNT, MOST, LEAST, 0DEBB20E3h
            .word   ALIGN_HALF, ALIGN_COARSE, ALIGN_END, ALIGN_UPDATE, ALIGN_VARIANCE
            .word   MOST_WAITING, DRAINED
CONSTANTS   .set    $-constants
