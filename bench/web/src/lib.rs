//! The bench and the base station in WebAssembly, for a page without a server.
//!
//! `cargo xtask web` builds this crate for `wasm32-wasip1`, and `worker.js` calls it in a worker of the page. The page
//! passes the firmwares and begins a flight ([`flight`]). Then it requests each step, the state of the base station's
//! page, the panel and the wires ([`request`]).
//!
//! # Exported functions
//!
//! | function | what |
//! |---|---|
//! | `room(length)` | makes room for a message of this length, and returns its address |
//! | `load(board)` | takes the message as the packed firmware of a board: 0 HORUS, 1 the DPR, 2 the hold |
//! | `ask()` | takes the message as a [`request::Request`] in JSON |
//! | `answer()` | returns the address of the answer to the last `load` or `ask` |
//!
//! `load` and `ask` return the length of the answer. A negative length is that of an error in words.
//!
//! A firmware has the format of [`Firmware::pack`](emulator_node::Firmware::pack). The program uses WASI only to write
//! the message of a panic to standard error. There are no files and no threads.

mod digest;
pub mod flight;
pub mod request;
mod wires;

use std::cell::RefCell;

use request::Bench;

thread_local! {
    static MESSAGE: RefCell<Vec<u8>> = const { RefCell::new(vec![]) };
    static ANSWER: RefCell<Vec<u8>> = const { RefCell::new(vec![]) };
    static BENCH: RefCell<Bench> = RefCell::default();
}

fn answered(result: Result<Vec<u8>, String>) -> i32 {
    let (sign, bytes) = match result {
        Ok(bytes) => (1, bytes),
        Err(words) => (-1, words.into_bytes()),
    };
    let length = i32::try_from(bytes.len()).unwrap_or(i32::MAX);
    ANSWER.set(bytes);
    sign * length
}

/// Makes room for a message of `length` bytes, and returns its address.
// SAFETY: no other function of the program has this name.
#[unsafe(no_mangle)]
pub extern "C" fn room(length: usize) -> *const u8 {
    MESSAGE.set(vec![0; length]);
    MESSAGE.with_borrow(Vec::as_ptr)
}

/// Takes the message as the firmware of a board: 0 HORUS, 1 the DPR, 2 the hold.
// SAFETY: no other function of the program has this name.
#[unsafe(no_mangle)]
pub extern "C" fn load(board: u32) -> i32 {
    answered(BENCH.with_borrow_mut(|bench| bench.load(board, &MESSAGE.take())))
}

/// Takes the message as a request.
// SAFETY: no other function of the program has this name.
#[unsafe(no_mangle)]
pub extern "C" fn ask() -> i32 {
    answered(BENCH.with_borrow_mut(|bench| bench.ask(&MESSAGE.take())))
}

/// Returns the address of the last answer.
// SAFETY: no other function of the program has this name.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    ANSWER.with_borrow(Vec::as_ptr)
}
