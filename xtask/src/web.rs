//! Writes the whole system as a page without a server: the bench and the base station in WebAssembly, both firmwares,
//! and the base station's page with the panel.

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use emulator_node::Firmware;
use miniz_oxide::deflate::compress_to_vec;

use crate::workspace::{cargo, check, target_dir};
use crate::{Receivers, firmware};

/// The target for which the bench is built: WebAssembly with WASI's names for standard error.
const TARGET: &str = "wasm32-wasip1";

/// The greatest compressed size of all files, bytes.
const MOST: usize = 3_000_000;

/// The files that are written as they are.
const FILES: [(&str, &str); 10] = [
    ("icon.svg", include_str!("../../base-station/src/live/page/icon.svg")),
    ("page.css", include_str!("../../base-station/src/live/page/page.css")),
    ("page.js", include_str!("../../base-station/src/live/page/page.js")),
    ("hold.js", include_str!("../../base-station/src/live/page/hold.js")),
    ("panel.css", include_str!("live/panel/panel.css")),
    ("panel.js", include_str!("live/panel/panel.js")),
    ("bench.css", include_str!("../../bench/web/page/bench.css")),
    ("flight.js", include_str!("../../bench/web/page/flight.js")),
    ("wires.js", include_str!("../../bench/web/page/wires.js")),
    ("worker.js", include_str!("../../bench/web/page/worker.js")),
];

/// The content security policy of the page, which loads nothing from elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self'; \
                      connect-src 'self'; worker-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'self'";

pub(crate) fn web() -> Result<ExitCode> {
    let folder = write()?;
    let size = compressed(&folder)?;
    println!(
        "{}: {:.2} MB compressed; any server of static files serves it, such as",
        folder.display(),
        size as f64 / 1e6
    );
    println!("python3 -m http.server --bind 127.0.0.1 --directory {} 8482", folder.display());
    ensure!(size <= MOST, "the page has {size} bytes compressed, and may have {MOST}");
    Ok(ExitCode::SUCCESS)
}

/// Returns the folder of the page. In `web` cargo keeps what that profile runs while it compiles, such as macros.
pub(crate) fn folder() -> PathBuf {
    target_dir().join("page")
}

/// Builds the page and returns its folder.
pub(crate) fn write() -> Result<PathBuf> {
    let (horus, dpr) = firmware::build_pair(Receivers::DEFAULT)?;
    let dpr_hold = firmware::build_dpr_with_hold(Receivers::DEFAULT)?;
    let images = [("horus", horus), ("dpr", dpr), ("dpr-hold", dpr_hold), ("hold", firmware::build_hold()?)];
    let mut command = cargo();
    command.args(["build", "--package", "bench-web", "--lib", "--target", TARGET, "--profile", "web"]);
    check("building the bench for a browser", &mut command)?;

    let folder = folder();
    // Files of an earlier build are removed.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    };
    let program = target_dir().join(TARGET).join("web/bench_web.wasm");
    let program = std::fs::read(&program).with_context(|| format!("cannot read {}", program.display()))?;
    put("bench.wasm", &program)?;
    for (board, image) in images {
        put(&format!("{board}.image"), &Firmware::read(&image)?.pack()?)?;
    }
    for (name, text) in FILES {
        put(name, text.as_bytes())?;
    }
    put("index.html", page()?.as_bytes())?;
    put("panel.html", panel()?.as_bytes())?;
    Ok(folder)
}

fn page() -> Result<String> {
    let page = include_str!("../../base-station/src/live/page/index.html");
    let policy = format!("<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">");
    let page = put_before(page, "<title>", &format!("{policy}\n"))?;
    let head = "<link rel=\"stylesheet\" href=\"bench.css\">\n<script src=\"flight.js\" defer></script>\n";
    let page = put_before(&page, "<script src=\"hold.js\"", head)?;
    let bench = include_str!("../../bench/web/page/bench.html");
    put_before(
        &page,
        "</body>",
        &format!("<div id=\"bench\">\n{bench}</div>\n<script src=\"wires.js\" defer></script>\n"),
    )
}

fn panel() -> Result<String> {
    let panel = include_str!("live/panel/index.html");
    let address = ", <a href=\"http://PAGE/\">http://PAGE/</a>, ";
    ensure!(panel.contains(address), "the panel's page has no {address}");
    Ok(panel.replace(address, " above "))
}

fn put_before(page: &str, mark: &str, text: &str) -> Result<String> {
    let (before, after) = page.split_once(mark).with_context(|| format!("the page has no {mark}"))?;
    Ok(format!("{before}{text}{mark}{after}"))
}

/// Returns the compressed size of all files in a folder, bytes, as a server sends them.
fn compressed(folder: &Path) -> Result<usize> {
    let mut size = 0;
    for file in std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        size += compress_to_vec(&std::fs::read(file?.path())?, 6).len();
    }
    Ok(size)
}
