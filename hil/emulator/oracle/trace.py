"""Plays a PIO program in rp2040-pio-emulator and prints the state after each instruction, as JSON.

Reads one JSON object on stdin: `opcodes` (all 32), `options` of `pioemu.emulate`, the `state` to begin with
(`program_counter`, `x_register`, `pin_directions`), the `words`, of which the first is in the OSR, `inputs` (levels of all pins
as bits, by clock cycle) and `cycles`. Each row that it prints is
[clock, pc, X, Y, OSR, bits out of OSR, ISR, bits in ISR, output pins, [words that were pushed]].
"""

import json
import sys
from collections import deque

from pioemu import ShiftRegister, State, emulate

job = json.load(sys.stdin)
inputs = job["inputs"]
directions = job["state"]["pin_directions"]
words = job["words"]
osr = ShiftRegister(words.pop(0), 0) if words else ShiftRegister(0, 32)


def levels(clock: int) -> int:
    return inputs[clock]


rows = []
states = emulate(
    job["opcodes"],
    stop_when=lambda _opcode, state: state.clock >= job["cycles"],
    initial_state=State(
        transmit_fifo=deque(words),
        output_shift_register=osr,
        **job["state"],
    ),
    input_source=levels,
    **job["options"],
)
for _, state in states:
    osr, isr = state.output_shift_register, state.input_shift_register
    rows.append(
        [
            state.clock,
            state.program_counter,
            state.x_register,
            state.y_register,
            osr.contents,
            osr.counter,
            isr.contents,
            isr.counter,
            state.pin_values & directions,
            list(state.receive_fifo),
        ]
    )
    # What was pushed is taken at once.
    state.receive_fifo.clear()
json.dump(rows, sys.stdout)
