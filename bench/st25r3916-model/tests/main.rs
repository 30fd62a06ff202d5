//! Tests of the front end's model, alone and with a second one on the air.

mod air;
mod air_chips;
mod air_late;
mod answers;
mod captures;
mod common;
mod controller;
mod exchange;
mod link;
mod misuse;
mod settings;
mod timing;
