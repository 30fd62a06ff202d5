//! Runs an image on QEMU's `mps2-an386` (Cortex-M4F).

use std::{
    path::Path,
    process::{Command, Stdio},
};

use anyhow::{Context, ensure};

/// Returns QEMU's version line.
///
/// # Errors
///
/// Returns an error if QEMU is not installed.
pub(crate) fn version() -> anyhow::Result<String> {
    let output = Command::new("qemu-system-arm").arg("--version").output().context("qemu-system-arm")?;
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

/// Runs `image` from address 0, and returns the contents of the file `name` that it wrote by semihosting.
///
/// # Errors
///
/// Returns an error if QEMU did not start or did not end successfully, or if the file is missing.
pub(crate) fn run(image: &[u8], name: &str, directory: &Path) -> anyhow::Result<Vec<u8>> {
    let image_path = directory.join("image.bin");
    std::fs::write(&image_path, image)?;
    let result_path = directory.join(name);
    let _ = std::fs::remove_file(&result_path);
    let output = Command::new("timeout")
        .args([
            "120",
            "qemu-system-arm",
            "-M",
            "mps2-an386",
            "-cpu",
            "cortex-m4",
            "-display",
            "none",
            "-serial",
            "none",
        ])
        .args(["-monitor", "none", "-semihosting-config", "enable=on,target=native", "-kernel", "image.bin"])
        .current_dir(directory)
        .stdin(Stdio::null())
        .output()
        .context("qemu-system-arm")?;
    ensure!(
        output.status.success(),
        "QEMU ended with {}: {}",
        output.status,
        String::from_utf8_lossy(&output.stderr).lines().take(3).collect::<Vec<_>>().join(" / ")
    );
    std::fs::read(&result_path).with_context(|| format!("{}", result_path.display()))
}
