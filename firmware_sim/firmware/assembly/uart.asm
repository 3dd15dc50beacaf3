; INT1: the UART. An edge requests it, so the service goes on until nothing is pending.

            .sect   "services"
uart_service:
            PUSH    ST
            PUSH    R0
            PUSH    R1
            PUSH    AR0
            PUSH    AR1
            PUSH    RS
            PUSH    RE
            PUSH    RC
            LDI     @uart_at,AR0
uart_next:  LDI     *+AR0(2),R0             ; IIR: reading it acknowledges the transmitter
            TSTB    1,R0
            BNZ     uart_end
            TSTB    4,R0
            BNZ     uart_receive

; The transmitter is empty: up to 16 bytes go from the ring to its FIFO; an empty ring switches it off.
            LDI     @tx_tail,R1
            SUBI    @tx_head,R1
            AND     RING-1,R1
            BZ      uart_off
            LDI     @tx_head,AR1
            CMPI    16,R1
            LDIGT   16,R1
            SUBI    1,R1
            LDI     R1,RC
            RPTB    uart_last
            LDI     *AR1++(1)%,R0
uart_last:  STI     R0,*AR0
            STI     AR1,@tx_head
            B       uart_next
uart_off:   LDI     1,R0
            STI     R0,*+AR0(1)
            B       uart_next

uart_receive:
            LDI     *+AR0(5),R0             ; line status: reading it clears its errors
            TSTB    1,R0
            BZ      uart_next
            LDI     @rx_tail,AR1
            LDI     *AR0,R0
            STI     R0,*AR1++(1)%
            STI     AR1,@rx_tail
            B       uart_next

uart_end:   POP     RC
            POP     RE
            POP     RS
            POP     AR1
            POP     AR0
            POP     R1
            POP     R0
            POP     ST
            RETI
