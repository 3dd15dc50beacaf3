; The short services: an external event, a failing supply, the wrap of the stopwatch.

            .sect   "services"
; INT2: the stopwatch is noted; the tick sends it.
event_service:
            PUSH    ST
            PUSH    R0
            PUSH    AR0
            LDI     @timer1_at,AR0
            LDI     @event,R0
            ADDI    1,R0
            STI     R0,@event
            LDI     *+AR0(4),R0
            STI     R0,@event+1
            POP     AR0
            POP     R0
            POP     ST
            RETI

; INT3: the tick's service runs at once, and its frame says why.
power_service:
            PUSH    ST
            PUSH    R0
            LDI     @extra_flags,R0
            OR      POWER_FLAG,R0
            STI     R0,@extra_flags
            OR      TICK_SOURCE,IF
            POP     R0
            POP     ST
            RETI

; TINT1
wrap_service:
            PUSH    ST
            PUSH    R0
            LDI     @wraps,R0
            ADDI    1,R0
            STI     R0,@wraps
            POP     R0
            POP     ST
            RETI
