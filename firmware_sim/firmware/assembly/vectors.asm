; Where the processor finds its services: reset at 0, the table of the interrupts at ITTP.

            .sect   "reset"
            .word   boot

            .sect   "vectors"
            .word   0
            .word   adc_service             ; INT0: end of conversion
            .word   uart_service            ; INT1
            .word   event_service           ; INT2: external event
            .word   power_service           ; INT3: power fails in 10 ms
            .word   0, 0                    ; serial port
            .word   0, 0
            .word   tick_service            ; TINT0
            .word   wrap_service            ; TINT1: the stopwatch wraps
            .word   0, 0                    ; DMA
