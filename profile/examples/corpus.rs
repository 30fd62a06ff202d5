//! Writes the committed fuzz corpus to `fuzz/corpus/`. Run it after a change of the wire format or of the seeds, and
//! commit the result; `tests/corpus.rs` fails until then.
use std::{fs, io, path::Path};

#[path = "../tests/support/mod.rs"]
mod support;

fn main() -> io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let mut files = 0;
    for (target, seeds) in support::seeds::all() {
        let directory = corpus.join(target);
        fs::create_dir_all(&directory)?;
        for (name, bytes) in seeds {
            fs::write(directory.join(name), bytes)?;
            files += 1;
        }
    }
    println!("{files} seeds in {}", corpus.display());
    Ok(())
}
