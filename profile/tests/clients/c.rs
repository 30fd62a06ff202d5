//! Compiles the C client with the machine's C compiler at test time.
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

pub(crate) const WARNINGS: &[&str] = &[
    "-std=c11",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wshadow",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wcast-align",
    "-Wcast-qual",
    "-Wswitch-default",
    "-Wundef",
    "-Wvla",
    "-Wdouble-promotion",
    "-Werror",
];

pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("c")
}

pub(crate) fn scratch(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("clients");
    std::fs::create_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    folder.join(name)
}

/// Runs the C compiler (`cc`, or the program in the variable CC) in `profile/c`.
pub(crate) fn compile(arguments: &[&str]) {
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let output = Command::new(&compiler).current_dir(folder()).args(arguments).output().unwrap_or_else(|error| {
        panic!("the C client's tests need a C compiler, `{compiler}` (set CC for another): {error}")
    });
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{compiler} {} failed:\n{text}", arguments.join(" "));
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Build {
    /// The player is compiled with the options of a flight controller's firmware.
    Optimised,
    /// The player is compiled with AddressSanitizer and UndefinedBehaviorSanitizer. Their first finding ends it.
    Sanitised,
}

impl Build {
    fn program(self) -> &'static Path {
        static PROGRAMS: [OnceLock<PathBuf>; 2] = [OnceLock::new(), OnceLock::new()];
        let (slot, name, options) = match self {
            Self::Optimised => (0, "play", &["-O2"][..]),
            Self::Sanitised => {
                (1, "play-sanitised", &["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"][..])
            }
        };
        PROGRAMS[slot].get_or_init(|| {
            let program = scratch(name);
            let path = program.to_str().expect("a path of text");
            let files = ["horus_dpr.c", "tests/tape.c", "tests/main.c", "-o", path];
            compile(&[WARNINGS, options, &files].concat());
            program
        })
    }

    pub(crate) fn play(self, tape: &[u8]) -> String {
        let mut child = Command::new(self.program())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program that was just made");
        let mut stdin = child.stdin.take().expect("piped");
        let output = std::thread::scope(|scope| {
            scope.spawn(move || stdin.write_all(tape).expect("it reads its tape"));
            child.wait_with_output().expect("it ends")
        });
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{self:?}: {}\n{errors}", output.status);
        String::from_utf8(output.stdout).expect("text")
    }
}
