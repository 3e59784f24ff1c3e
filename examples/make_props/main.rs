//! Writes the evidence kit in `scenes/`: `cargo run --example make_props [FOLDER]`.
//!
//! Everything is true to size, in metres, y up, standing or lying on y = 0. Everything is computed
//! here; the same program writes the same bytes. `scenes/kit.toml` lists the dimensions.

mod kit;

use std::path::PathBuf;

use anyhow::Context;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("scenes"), PathBuf::from);
    let kit = folder.join("kit");
    std::fs::create_dir_all(&kit).with_context(|| format!("{} cannot be made", kit.display()))?;
    for item in kit::items() {
        let path = folder.join(&item.file);
        let bytes = (item.make)().to_glb()?;
        std::fs::write(&path, &bytes).with_context(|| format!("{} cannot be written", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
