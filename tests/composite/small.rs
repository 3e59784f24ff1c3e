//! The demonstration's recording at a fraction of its resolution.

use std::fs;
use std::path::{Path, PathBuf};

use crate::fixture;
use image::imageops::{FilterType, resize};

const DEMO: &str = "recordings/demo";

/// A copy of `recordings/demo` at 1/`factor` of its resolution, with the same poses, times, noise and field
/// of view. Colours are filtered means; depth is sampled without filtering.
pub fn demo(factor: u32) -> PathBuf {
    fixture::once("demo-reduced", factor, |folder| reduce(Path::new(DEMO), folder, factor))
}

fn reduce(from: &Path, to: &Path, factor: u32) {
    for file in ["recording.toml", "exposure.txt", "groundtruth.txt", "rgb.txt", "depth.txt"] {
        fs::copy(from.join(file), to.join(file)).unwrap();
    }
    let camera = fs::read_to_string(from.join("camera.toml")).unwrap();
    fs::write(to.join("camera.toml"), reduced_profile(&camera, factor)).unwrap();
    for sub in ["rgb", "depth"] {
        fs::create_dir(to.join(sub)).unwrap();
        for entry in fs::read_dir(from.join(sub)).unwrap() {
            let path = entry.unwrap().path();
            let out = to.join(sub).join(path.file_name().unwrap());
            let picture = image::open(&path).unwrap();
            let [width, height] = [picture.width(), picture.height()].map(|side| side / factor);
            if sub == "rgb" {
                resize(&picture.into_rgb8(), width, height, FilterType::Triangle).save(out).unwrap();
            } else {
                resize(&picture.into_luma16(), width, height, FilterType::Nearest).save(out).unwrap();
            }
        }
    }
}

/// A camera profile at 1/`factor` of its resolution.
fn reduced_profile(text: &str, factor: u32) -> String {
    let line = |line: &str| match line.split_once(" = ") {
        Some((key @ ("width_px" | "height_px"), value)) => {
            format!("{key} = {}", value.parse::<u32>().unwrap() / factor)
        }
        Some((key @ ("fx_px" | "fy_px" | "cx_px" | "cy_px"), value)) => {
            format!("{key} = {:?}", value.parse::<f64>().unwrap() / f64::from(factor))
        }
        _ => line.to_owned(),
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}
