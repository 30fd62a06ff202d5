//! Carries out gdb's `monitor` commands, which serve functions of the emulator that gdb has no command for.

use emulator_part::Pin;

use super::World;
use super::target::Debuggee;
use emulator_node::Resume;

const HELP: &str = "\
monitor time                    virtual time, instructions, what the core does
monitor pins                    every pin that is high
monitor pin NAME                the level of a pin: P1.05, PA5
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
            other => match self.world.monitor(other) {
                Some(text) => text,
                None => format!("no monitor command \"{command}\"; these are:\n{}", self.help()),
            },
        })
    }

    fn help(&self) -> String {
        [W::HELP, HELP].concat()
    }

    fn time(&mut self) -> String {
        let end = match self.world.end() {
            u64::MAX => String::new(),
            end => format!(" of {:.0} ms", end as f64 / 1e6),
        };
        let node = self.node();
        let (ms, instructions, doing) = (node.now() as f64 / 1e6, node.instructions(), node.doing());
        format!("{ms:.6} ms{end}, {instructions} instructions; {doing}\n")
    }

    fn named(&mut self, name: &str) -> Result<Pin, String> {
        let pins = self.node().pins();
        pins.find(name).ok_or_else(|| format!("this board has no pin \"{name}\": it has {pins}\n"))
    }

    fn pins(&mut self) -> String {
        let node = self.node();
        let names = node.pins();
        let high: Vec<String> = names.all().filter(|pin| node.pin(*pin)).map(|pin| names.name(pin)).collect();
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
