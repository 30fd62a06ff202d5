//! Runs all tests of the link in one binary, so that the emulator is compiled only once.

mod babble;
mod boards;
mod buffers;
mod campaign;
mod clock;
mod debug_port;
mod dpr;
mod drawn;
mod elf;
mod faults;
mod flow;
mod gdb;
mod hang;
mod hold;
mod hold_outputs;
mod injected;
mod integrity;
mod kept_state;
mod link;
mod memory_protection;
mod phases;
#[path = "../../emulator/node/tests/player/mod.rs"]
mod player;
mod port;
mod ports;
mod reader;
mod receivers;
mod recovery;
mod runner;
mod sequence;
mod snapshot;
mod sums;
mod supply;
mod tasks;
#[path = "../../emulator/node/tests/thumb/mod.rs"]
mod thumb;
mod trace;
mod violations;
mod waves;
mod wrong_setup;
