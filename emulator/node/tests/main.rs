//! The tests of the node in one binary.

mod lockstep;
mod node;
mod player;
mod power;
mod relay;
mod rewriting;
mod thumb;
