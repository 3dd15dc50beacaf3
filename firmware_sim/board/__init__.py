"""The circuit around the processor: clock, interrupts, timers, A/D front end, UART and serial line."""
