//! Writes the initial inputs of the fuzz targets into `base-station/fuzz/corpus`. Tests fail if other inputs are there.

#[path = "../tests/parsers/bodies.rs"]
mod bodies;

fn main() -> std::io::Result<()> {
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    for (parser, name, bytes) in bodies::seeds() {
        let folder = corpus.join(parser);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}
