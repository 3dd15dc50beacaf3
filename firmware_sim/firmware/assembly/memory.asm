; What the services remember, on chip, in the data page that all code keeps in DP.

; Filled by boot from the list of constants, in the order of that list.
adc_at      .usect  "onchip",1
uart_at     .usect  "onchip",1
timer0_at   .usect  "onchip",1
timer1_at   .usect  "onchip",1
watchdog_at .usect  "onchip",1
sums_at     .usect  "onchip",1      ; where the A/D service adds
part2_at    .usect  "onchip",1      ; the second half of them
solver_at   .usect  "onchip",1      ; where the solver reads its sums
frame_at    .usect  "onchip",1
event_at    .usect  "onchip",1
answer_at   .usect  "onchip",1
crc_at      .usect  "onchip",1
command_at  .usect  "onchip",1      ; the command that is being received, from its type on
tx_head     .usect  "onchip",1      ; of the ring of bytes to send: the next one, and the next free place
tx_tail     .usect  "onchip",1
rx_head     .usect  "onchip",1
rx_tail     .usect  "onchip",1
first_at    .usect  "onchip",1      ; the first description, and the one that comes next
described   .usect  "onchip",1
new_scale_at .usect "onchip",1      ; where a new scale is offered
period      .usect  "onchip",1      ; of the tick, in counts of a timer
first_part  .usect  "onchip",1      ; samples of the first half of a cycle
safe_count  .usect  "onchip",1      ; up to so many samples no sum can outgrow its bounds
most        .usect  "onchip",1      ; the bounds of a sum
least       .usect  "onchip",1
crc_residue .usect  "onchip",1      ; what a CRC over its own bytes leaves
align_half  .usect  "onchip",1      ; of an alignment: samples to its stages, and the variance of the velocity
align_coarse .usect "onchip",1
align_end   .usect  "onchip",1
align_update .usect "onchip",1
align_variance .usect "onchip",1
most_waiting .usect "onchip",1      ; the account of what waits for the line: its limit, and what a tick takes off
drained     .usect  "onchip",1

; Cleared by boot.
sums        .usect  "onchip",12     ; gyro x y z, accelerometer x y z of both halves
samples     .usect  "onchip",1      ; in the sums
adc_status  .usect  "onchip",1      ; all that the status register said since the last tick
number      .usect  "onchip",1      ; of the last sample
lost        .usect  "onchip",1      ; samples that were never read
height_mm   .usect  "onchip",1
climb_mmps  .usect  "onchip",1

began       .usect  "onchip",1      ; stopwatch where the tick's service began
due         .usect  "onchip",1      ; stopwatch at the tick itself
tick        .usect  "onchip",1      ; its number
taken       .usect  "onchip",1      ; samples in this cycle
taken_status .usect "onchip",1
taken_height .usect "onchip",1
taken_climb .usect  "onchip",1
sample_bits .usect  "onchip",1      ; flags of its samples
solution    .usect  "onchip",1      ; flags of the solver
mode        .usect  "onchip",1
next_mode   .usect  "onchip",1      ; what the alignment makes of it, from the next cycle on
has_start   .usect  "onchip",1      ; the states have been set
extra_flags .usect  "onchip",1      ; power fails, the watchdog has bitten
is_dropped  .usect  "onchip",1      ; the frame before found no room

due_words   .usect  "onchip",1      ; when descriptions are sent: see describe
credit      .usect  "onchip",1
waited      .usect  "onchip",1
waiting     .usect  "onchip",1      ; bytes, as the account counts them

received    .usect  "onchip",1      ; bytes of a command so far
rx_seen     .usect  "onchip",1      ; the receive ring's end at the last tick
is_ready    .usect  "onchip",1      ; a whole command waits for the tick
bad_commands .usect "onchip",1

frame       .usect  "onchip",25     ; the navigation frame, word by word
event       .usect  "onchip",2      ; number of the last external event, and the stopwatch there
event_sent  .usect  "onchip",1
answer      .usect  "onchip",2      ; number of the last command, and what became of it
has_answer  .usect  "onchip",1
wraps       .usect  "onchip",1      ; of the stopwatch
            .if     SPECTRUM
sample_at   .usect  "onchip",1      ; where the next sample is kept, and where that was at the tick
window_end  .usect  "onchip",1
            .endif

stack       .usect  "onchip",1      ; and the rest of the on-chip RAM

tx_ring     .usect  "tx_ring",RING
rx_ring     .usect  "rx_ring",RING
command     .usect  "command",264
