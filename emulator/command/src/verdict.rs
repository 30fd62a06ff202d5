//! The verdict on a run: its summary, its status, and hints for the user.

use emulator_node::{Clock, Firmware, Outcome, Target};

use crate::output::milliseconds;

pub(crate) fn summary(outcome: &Outcome, clock: Clock) -> String {
    let findings = outcome.findings.len();
    let resets = outcome.resets;
    let stack = match outcome.stack {
        // If the firmware's own RAM test writes to the whole stack, the use of the stack is not known.
        Some((used, size)) if used == size => format!(", all {size} bytes of the stack written"),
        Some((used, size)) => format!(", stack {used} of {size} bytes at worst"),
        None => String::new(),
    };
    format!(
        "{:.3} ms of virtual time, load {:.1} %{stack}, {findings} finding{}, {resets} restart{}, \
         {:.3} million instructions on the {clock} clock",
        milliseconds(outcome.virtual_time),
        outcome.load * 100.0,
        if findings == 1 { "" } else { "s" },
        if resets == 1 { "" } else { "s" },
        outcome.instructions as f64 / 1e6,
    )
}

/// Returns a message about the run, if one is needed, and the run's status. `seconds` is the time that the run was
/// meant to take, if any. Otherwise `limit` is the longest time that the run may take.
pub(crate) fn verdict(seconds: Option<f64>, limit: f64, outcome: &Outcome) -> (Option<String>, u32) {
    if outcome.exit.is_none() && !outcome.died {
        let restarts = match outcome.resets {
            0 => String::new(),
            1 => ", after a restart".to_owned(),
            count => format!(", after {count} restarts"),
        };
        let doing = &outcome.doing;
        if let Some(seconds) = seconds {
            let well = outcome.findings.is_empty() && !outcome.stopped_itself;
            let (error, whether) = if well { ("", "") } else { ("error: ", "not ") };
            let says = format!(
                "{error}still running after {seconds} s of virtual time, {whether}as it should (--seconds){restarts}: \
                 {doing}"
            );
            return (Some(says), u32::from(!well));
        }
        let says = format!(
            "error: still running after {limit} s of virtual time (--limit){restarts}: {doing}\n\
             If it is meant to run on for ever, say --seconds instead."
        );
        return (Some(says), outcome.status());
    }
    // If the emulator has found an error, the run fails even if the firmware reports success.
    (None, if outcome.status() == 0 && !outcome.passed() { 1 } else { outcome.status() })
}

pub(crate) fn linked_elsewhere(target: Target, firmware: &Firmware) -> Option<String> {
    // A program for the nRF52840 can be loaded at address 0 of the STM32, which has flash there too. The program is
    // linked for other addresses and would not run.
    const STM32_FLASH: u64 = 0x0800_0000;
    let lies_below = firmware.segments().iter().all(|(address, _)| *address < STM32_FLASH);
    (target == Target::Stm32f429 && lies_below).then(|| {
        let name = firmware.name();
        format!(
            "{name} has nothing at {STM32_FLASH:#010x}, where the {} has its flash: is it linked for this part?",
            target.name()
        )
    })
}

pub(crate) fn said_nothing(firmware: &Firmware, outcome: &Outcome) -> Option<&'static str> {
    if !outcome.lines.is_empty() {
        return None;
    }
    Some(if firmware.has_defmt() {
        "It logged nothing. Which of its defmt messages are compiled in, DEFMT_LOG says as it is built: DEFMT_LOG=info."
    } else {
        "It printed nothing. Text comes over RTT, by semihosting, or from a UART with --uart PIN=-."
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_firmware_that_has_stopped_itself_is_not_running_as_it_should() {
        let outcome = Outcome {
            exit: None,
            died: false,
            virtual_time: 1_000_000_000,
            lines: vec![],
            findings: vec![],
            resets: 0,
            load: 1.0,
            instructions: 0,
            stack: None,
            doing: "it runs in main".to_owned(),
            stopped_itself: false,
        };
        let (says, status) = verdict(Some(1.0), 60.0, &outcome);
        assert_eq!(says.unwrap(), "still running after 1 s of virtual time, as it should (--seconds): it runs in main");
        assert_eq!(status, 0);
        let (says, status) = verdict(Some(1.0), 60.0, &Outcome { stopped_itself: true, ..outcome.clone() });
        assert!(says.unwrap().starts_with("error: still running after 1 s of virtual time, not as it should"));
        assert_eq!(status, 1);
        assert_eq!(verdict(None, 60.0, &outcome).1, 124);
    }
}
