; INT0: a conversion has ended. The six latches are added as integers; reading the last one frees them.

            .sect   "services"
adc_service:
            PUSH    ST
            PUSH    R0
            PUSH    R1
            PUSH    AR0
            PUSH    AR1
            LDI     @adc_at,AR0
            LDI     @sums_at,AR1
            LDI     @samples,R1
            ADDI    1,R1
            STI     R1,@samples
            CMPI    @first_part,R1
            LDIGT   @part2_at,AR1           ; the second half of the cycle
            LDI     *AR0,R0                 ; status: what it says is cleared, but for the end of conversion
            ANDN    1,R0
            STI     R0,*AR0
            OR      @adc_status,R0
            STI     R0,@adc_status
            LDI     *+AR0(8),R0
            STI     R0,@height_mm
            LDI     *+AR0(9),R0
            STI     R0,@climb_mmps
            CMPI    @safe_count,R1
            BGTD    adc_bounded
            LDI     *+AR0(7),R0             ; number: a step of more than one is a loss
            LDI     R0,R1
            SUBI    @number,R1
            STI     R0,@number
            .if     SPECTRUM
            PUSH    AR2
            LDI     @sample_at,AR2
            .loop   3
            LDI     *++AR0,R0               ; a gyro: kept beside the sum
            ADDI3   *AR1,R0,R0
||          STI     R0,*AR2++(1)%
            STI     R0,*AR1++
            .endloop
            LDI     @number,R0
            STI     R0,*AR2++(1)%
            STI     AR2,@sample_at
            POP     AR2
            .loop   3
            LDI     *++AR0,R0
            ADDI    *AR1,R0
            STI     R0,*AR1++
            .endloop
            .else
            .loop   6
            LDI     *++AR0,R0
            ADDI    *AR1,R0
            STI     R0,*AR1++
            .endloop
            .endif
adc_end:    SUBI    1,R1
            ADDI    @lost,R1
            STI     R1,@lost
            POP     AR1
            POP     AR0
            POP     R1
            POP     R0
            POP     ST
            RETI

; After missed ticks a sum could outgrow its bounds: it stays there, so that both halves still add up to a word.
adc_bounded:
            STI     R0,@number
            PUSH    R2
            PUSH    AR2
            .if     SPECTRUM
            PUSH    AR3
            LDI     @sample_at,AR3
            .endif
            LDI     5,AR2
adc_channel: LDI    *++AR0,R0
            .if     SPECTRUM
            STI     R0,*AR3++(1)%           ; three too many: the number and the next sample go over them
            .endif
            ADDI    *AR1,R0
            LDI     R0,R2
            CMPI    @most,R0
            LDIGT   @most,R0
            CMPI    @least,R0
            LDILT   @least,R0
            STI     R0,*AR1++
            CMPI    R0,R2
            BEQ     adc_fits
            LDI     @adc_status,R2
            OR      SATURATED,R2
            STI     R2,@adc_status
adc_fits:   DB      AR2,adc_channel
            .if     SPECTRUM
            LDI     @sample_at,AR3
            NOP     *AR3++(3)%
            LDI     @number,R0
            STI     R0,*AR3++(1)%
            STI     AR3,@sample_at
            POP     AR3
            .endif
            POP     AR2
            POP     R2
            B       adc_end
