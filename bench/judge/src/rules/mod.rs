//! The rules of the judge. Each is a type that processes every event of a run and records violations.
//!
//! | file | what it judges |
//! |---|---|
//! | [`cycle`] | ticks, transmit commands, frames, their timestamps and their timing |
//! | [`content`] | what HORUS sends, compared with the bytes that its receivers have sent |
//! | [`receivers`] | whether HORUS reads the bytes that its receivers offer |
//! | [`position`] | whether there is a position, and whether the aircraft was there |
//! | [`boards`] | restarts, findings, misuse, load, the firmwares' own counters, the bench's own lateness |
//! | [`integrity`] | whether a fault of memory has its consequence |
//! | [`ssi`] | transactions, readiness, FRESH, and what is torn or damaged |
//! | [`shown`] | what is shown, compared with what reached the DPR's antenna: absence, sequence, age |
//! | [`link_status`] | Link-Status, compared with what was on the wires |
//! | [`port`] | Port-Status and uplinks, compared with what the flight controller wrote |
//! | [`hold`] | the active hold: its objects, answers, commands and outputs |
//! | [`heater`] | the active hold's heater, whatever disturbs the hold |
//! | [`client`] | the verdict of the flight controller's client, compared with what was on the wires |
//! | [`base`] | what the base station shows, compared with what was forwarded, and whether it was forwarded |
//! | [`station`] | the base station's ages and alarms, compared with the profiles that have arrived there |

pub mod base;
pub mod boards;
pub mod client;
pub mod content;
pub mod cycle;
pub mod heater;
pub mod hold;
pub mod integrity;
pub mod link_status;
pub mod port;
pub mod position;
pub mod receivers;
pub mod shown;
pub mod ssi;
pub mod station;

use crate::{Context, Event, Figures, Findings, Header};

/// Formats an instant for a human reader.
fn ms(at: u64) -> String {
    format!("{:.6} ms", at as f64 / 1e6)
}

/// Returns whether the counter or timestamp `a` is after `b`; both wrap.
fn is_later(a: u32, b: u32) -> bool {
    (1..1 << 31).contains(&a.wrapping_sub(b))
}

/// A rule of the judge.
pub trait Rule {
    /// Returns the rule's state at the beginning of a run.
    ///
    /// # Panics
    ///
    /// Panics if no profile has the header's number of receivers.
    fn new(header: &Header) -> Self;

    /// Processes the next event; `context` already includes that event.
    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings);

    /// Ends the run: judges what could not be judged before its end, and adds the rule's figures.
    fn finish(&mut self, _context: &Context, _findings: &mut Findings, _figures: &mut Figures) {}
}

macro_rules! rules {
    ($($name:ident: $rule:ty,)*) => {
        /// All rules.
        #[derive(Clone, Debug)]
        pub struct Rules {
            $($name: $rule,)*
        }

        impl Rule for Rules {
            fn new(header: &Header) -> Self {
                Self { $($name: <$rule>::new(header),)* }
            }

            fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
                $(self.$name.take(event, context, findings);)*
            }

            fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
                $(self.$name.finish(context, findings, figures);)*
            }
        }
    };
}

rules! {
    cycle: cycle::Cycle,
    content: content::Content,
    receivers: receivers::Receivers,
    position: position::Position,
    ssi: ssi::Ssi,
    shown: shown::Shown,
    link_status: link_status::LinkStatus,
    port: port::PortRule,
    integrity: integrity::Integrity,
    client: client::Client,
    base: base::Base,
    station: station::Station,
    boards: boards::Boards,
    hold: hold::Hold,
    heater: heater::Heater,
}
