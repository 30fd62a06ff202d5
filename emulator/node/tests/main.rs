//! The tests of the node in one binary: each file is a module of it.

mod lockstep;
mod node;
mod player;
mod power;
mod relay;
mod rewriting;
mod thumb;
