//! Carries out gdb's `monitor` commands, which serve functions of the bench that gdb has no command for.

use bench_judge::Board as Side;
use emulator_part::Pin;

use super::target::Debuggee;
use super::world::World;
use emulator_node::Resume;

const HELP: &str = "\
monitor time                    virtual time, instructions, what the core does
monitor pins                    every pin that is high
monitor pin NAME                the level of a pin: P1.05 (DPR), PA5 (HORUS)
monitor pin NAME high|low       drives it from outside from now on
monitor pin NAME release        lets go of it
monitor halt                    as monitor time: who can ask this has halted the board already
monitor reset [halt]            pulls the reset pin; halts before the first instruction
monitor help                    this
";

impl<W: World> Debuggee<W> {
    pub(super) fn monitor(&mut self, command: &str) -> Result<String, W::Error> {
        let words: Vec<&str> = command.split_whitespace().collect();
        Ok(match words.as_slice() {
            [] | ["help"] => self.help(),
            ["time"] => self.time(),
            ["pins"] => self.pins(),
            ["pin", name] => self.pin(name),
            ["pin", name, level] => self.drive(name, level),
            // Editors send OpenOCD's `halt` to any gdb server (cortex-debug's src/external.ts).
            ["halt"] => self.time(),
            ["reset"] | ["reset", "halt"] => self.reset()?,
            ["faults", list] => self.world.faults(list),
            _ => format!("no monitor command \"{command}\"; these are:\n{}", self.help()),
        })
    }

    fn help(&self) -> String {
        [W::FAULTS_HELP, HELP].concat()
    }

    fn time(&mut self) -> String {
        let end = self.world.end() as f64 / 1e6;
        let node = self.node();
        let (ms, instructions, doing) = (node.now() as f64 / 1e6, node.instructions(), node.doing());
        format!("{ms:.6} ms of {end:.0} ms, {instructions} instructions; {doing}\n")
    }

    fn names(&self) -> Vec<(String, Pin)> {
        let pins = |ports: u8, numbers: u8| {
            (0..ports).flat_map(move |port| (0..numbers).map(move |number| Pin::new(port, number)))
        };
        match self.world.side() {
            Side::Dpr => pins(2, 32)
                .filter(|pin| pin.port == 0 || pin.number < 16)
                .map(|pin| (format!("P{}.{:02}", pin.port, pin.number), pin))
                .collect(),
            // The HORUS microcontroller's package with 144 pins has PA0 to PH1.
            Side::Horus => pins(8, 16)
                .filter(|pin| pin.port < 7 || pin.number < 2)
                .map(|pin| (format!("P{}{}", char::from(b'A' + pin.port), pin.number), pin))
                .collect(),
        }
    }

    fn named(&self, name: &str) -> Result<Pin, String> {
        let found = self.names().into_iter().find(|(other, _)| other.eq_ignore_ascii_case(name));
        found.map(|(_, pin)| pin).ok_or_else(|| {
            let example = match self.world.side() {
                Side::Dpr => "P0.00 to P0.31 and P1.00 to P1.15",
                Side::Horus => "PA0 to PG15, PH0 and PH1",
            };
            format!("this board has no pin \"{name}\": it has {example}\n")
        })
    }

    fn pins(&mut self) -> String {
        let names = self.names();
        let node = self.node();
        let high: Vec<&str> = names.iter().filter(|(_, pin)| node.pin(*pin)).map(|(name, _)| name.as_str()).collect();
        format!("high: {}\nlow or floating: all others\n", high.join(" "))
    }

    fn pin(&mut self, name: &str) -> String {
        match self.named(name) {
            Ok(pin) => format!("{name} is {}\n", if self.node().pin(pin) { "high" } else { "low" }),
            Err(text) => text,
        }
    }

    fn drive(&mut self, name: &str, level: &str) -> String {
        let pin = match self.named(name) {
            Ok(pin) => pin,
            Err(text) => return text,
        };
        let driven = match level {
            "high" => Some(true),
            "low" => Some(false),
            "release" => None,
            _ => return format!("\"{level}\" is no level: high, low or release\n"),
        };
        self.node().drive(pin, driven);
        self.pin(name)
    }

    fn reset(&mut self) -> Result<String, W::Error> {
        self.node().halt_after_reset(true);
        self.node().resume(Resume::Continue);
        self.world.pull_reset();
        while self.go()?.is_none() {}
        self.node().halt_after_reset(false);
        let mut text = self.time();
        text.push_str("gdb has old registers: \"maintenance flush register-cache\", or go on\n");
        Ok(text)
    }
}
