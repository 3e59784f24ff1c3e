//! Writes the evidence props in `scenes/`: `cargo run --example make_props [FOLDER]`.
//!
//! Marker tents, a photographic L-scale and a cartridge case, true to size, metres, y up,
//! standing on y = 0. Everything is computed here; the same program writes the same bytes.

mod canvas;
mod cartridge;
mod glb;
mod l_scale;
mod marker;
mod shape;

use std::path::PathBuf;

use anyhow::Context;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("scenes"), PathBuf::from);
    std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
    let mut props: Vec<_> = (1..=9).map(|n| (format!("marker-{n}.glb"), marker::marker(n))).collect();
    props.push(("l-scale.glb".to_owned(), l_scale::l_scale()));
    props.push(("cartridge-case-9mm.glb".to_owned(), cartridge::cartridge()));
    for (name, prop) in props {
        let path = folder.join(name);
        let bytes = prop.to_glb()?;
        std::fs::write(&path, &bytes).with_context(|| format!("{} cannot be written", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
