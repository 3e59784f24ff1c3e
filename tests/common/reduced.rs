//! Copies of the demonstration's recording with fewer pixels and frames.

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::fs;
use std::path::{Path, PathBuf};

use image::{ImageBuffer, Luma, RgbImage};

use super::fixture;

const DEMO: &str = "recordings/demo";

/// Size of a copy of the demonstration.
#[derive(Clone, Copy, Debug, Hash)]
pub struct Reduction {
    /// Divisor of the pictures' width and height.
    pub factor: u32,
    /// Step between the frames of the demonstration that the copy has.
    pub stride: usize,
    /// Largest number of frames of the copy.
    pub max_frames: usize,
    /// False if the copy's profile turns shadows off.
    pub has_shadows: bool,
}

impl Reduction {
    /// All frames at 1/`factor` of the width and height.
    pub const fn by(factor: u32) -> Self {
        Self { factor, stride: 1, max_frames: usize::MAX, has_shadows: true }
    }

    /// Path of the copy, a folder `demo` in a fixture. Poses, times, noise and field of view are
    /// those of the demonstration.
    pub fn demo(self) -> PathBuf {
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join(DEMO);
        fixture::once("demo-reduced", &[DEMO], self, |to| self.copy(&from, &to.join("demo"))).join("demo")
    }

    fn copy(self, from: &Path, to: &Path) {
        let text = |name: &str| fs::read_to_string(from.join(name)).unwrap();
        for sub in ["rgb", "depth"] {
            fs::create_dir_all(to.join(sub)).unwrap();
        }
        for file in ["recording.toml", "groundtruth.txt"] {
            fs::copy(from.join(file), to.join(file)).unwrap();
        }
        for name in ["rgb.txt", "depth.txt", "exposure.txt"] {
            let list = self.list(&text(name));
            let of_copy = if self.factor == 1 { list.clone() } else { list.replace(".jpg", ".png") };
            fs::write(to.join(name), of_copy).unwrap();
            if name != "exposure.txt" {
                for file in list.lines().skip(1).map(|line| line.split(' ').nth(1).unwrap()) {
                    self.picture(&from.join(file), &to.join(file));
                }
            }
        }
        fs::write(to.join("camera.toml"), self.profile(&text("camera.toml"))).unwrap();
    }

    /// The title of a list and the lines of the copy's frames.
    fn list(self, text: &str) -> String {
        let frames = text.lines().skip(1).step_by(self.stride).take(self.max_frames);
        text.lines().take(1).chain(frames).map(|line| format!("{line}\n")).collect()
    }

    /// Copies a picture or a depth map.
    fn picture(self, from: &Path, to: &Path) {
        if self.factor == 1 {
            fs::copy(from, to).unwrap();
            return;
        }
        let to = to.with_extension("png");
        match image::open(from).unwrap() {
            image::DynamicImage::ImageLuma16(depth) => self.depth(&depth).save(to).unwrap(),
            color => self.color(&color.into_rgb8()).save(to).unwrap(),
        }
    }

    /// The mean of each block of pixels.
    fn color(self, from: &RgbImage) -> RgbImage {
        image::imageops::thumbnail(from, from.width() / self.factor, from.height() / self.factor)
    }

    /// The median of each block of pixels: at an edge a measured depth of one side, no mixture.
    fn depth(self, from: &ImageBuffer<Luma<u16>, Vec<u16>>) -> ImageBuffer<Luma<u16>, Vec<u16>> {
        let factor = self.factor;
        ImageBuffer::from_fn(from.width() / factor, from.height() / factor, |x, y| {
            let block = (0..factor * factor).map(|i| (factor * x + i % factor, factor * y + i / factor));
            let mut codes: Vec<u16> = block.map(|(x, y)| from.get_pixel(x, y)[0]).collect();
            codes.sort_unstable();
            Luma([codes[codes.len() / 2]])
        })
    }

    /// The camera's profile.
    fn profile(self, text: &str) -> String {
        let reduced = |line: &str| match line.split_once(" = ") {
            Some((key @ ("width_px" | "height_px"), value)) => {
                format!("{key} = {}\n", value.parse::<u32>().unwrap() / self.factor)
            }
            Some((key @ ("fx_px" | "fy_px" | "cx_px" | "cy_px"), value)) => {
                format!("{key} = {:?}\n", value.parse::<f64>().unwrap() / f64::from(self.factor))
            }
            _ => format!("{line}\n"),
        };
        let camera: String = text.lines().map(reduced).collect();
        if self.has_shadows { camera } else { camera + "\n[shadow]\ncast = false\non_evidence = false\n" }
    }
}
