//! The written layers contain everything that a composite changes in the footage.

use std::path::Path;

use exr::prelude::read_first_flat_layer_from_file;
use locard::compositor::{Composited, Compositor, IN_FLIGHT, Settings};
use locard::frame::Frame;
use locard::params::Value;
use locard::sink::exr::write_layers;

use crate::gpu;
use crate::reduced::Reduction;
use crate::site::{NamedShot, demo_like, desk};
use crate::tier::is_full;

/// A frame of a recording composited with its evidence.
fn composited(compositor: &mut Compositor, site: &mut NamedShot, settings: Settings, frame: usize) -> Composited {
    site.shot.settings = settings;
    site.shot.frames(compositor, frame..frame + 1, true, IN_FLIGHT).unwrap().next().unwrap().unwrap()
}

/// The unmodified frame.
fn camera(site: &NamedShot, frame: usize) -> Frame {
    site.shot.recording.frames(frame..frame + 1).unwrap().next().unwrap().unwrap()
}

/// A channel of an OpenEXR file, row by row.
fn channel(file: &Path, name: &str) -> Vec<f32> {
    let image = read_first_flat_layer_from_file(file).unwrap();
    let channels = &image.layer_data.channel_data.list;
    let channel = channels.iter().find(|channel| channel.name.to_string() == name);
    channel.unwrap_or_else(|| panic!("no channel {name}")).sample_data.values_as_f32().collect()
}

/// The layers of a frame as read from their file, with the codes before and after compositing.
struct Layers {
    coverage: Vec<f32>,
    /// By colour channel.
    light: [Vec<f32>; 3],
    ratio: [Vec<f32>; 3],
    noise: [Vec<f32>; 3],
    camera: Vec<u8>,
    composite: Vec<u8>,
}

impl Layers {
    fn of(site: &mut NamedShot, settings: &Settings, frame: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut compositor = site.shot.compositor(gpu::gpu().clone());
        let done = composited(&mut compositor, site, settings.clone(), frame);
        let file = folder.path().join("layers.exr");
        write_layers(&file, done.layer.as_ref().unwrap(), None, false).unwrap();
        let by_color = |name: &str| ["R", "G", "B"].map(|color| channel(&file, &format!("{name}.{color}")));
        let codes = |pixels: &locard::pixels::Pixels| pixels.codes.eight_bit().unwrap().to_vec();
        Self {
            coverage: channel(&file, "virtual.A"),
            light: by_color("virtual"),
            ratio: by_color("shadow"),
            noise: by_color("noise"),
            camera: codes(&camera(site, frame).pixels),
            composite: codes(&done.pixels),
        }
    }

    /// Difference between the composite's code and the layers over the footage.
    fn deviation(&self, site: &NamedShot, pixel: usize, color: usize, with_noise: bool) -> f64 {
        let response = &site.shot.rig.response;
        let real = response.decode(f64::from(self.camera[3 * pixel + color]) / 255.0);
        let noise = if with_noise { f64::from(self.noise[color][pixel]) } else { 0.0 };
        let left = f64::from((1.0 - self.coverage[pixel]) * self.ratio[color][pixel]);
        let over = f64::from(self.light[color][pixel]) + noise + left * real;
        let expected = (255.0 * response.encode(over.max(0.0))).min(255.0);
        (f64::from(self.composite[3 * pixel + color]) - expected).abs()
    }

    /// Every pixel and colour channel.
    fn pixel_channels(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        (0..self.coverage.len()).flat_map(|pixel| (0..3).map(move |color| (pixel, color)))
    }
}

fn sites() -> impl Iterator<Item = NamedShot> {
    [Some(demo_like(&Reduction::by(2).demo())), is_full().then(desk).flatten()].into_iter().flatten()
}

#[test]
fn layers_over_the_footage_match_the_composite_within_one_code() {
    // The sensor's noise and the edge blend act on codes, and chromatic aberration separates a
    // pixel's coverage by colour.
    let mut settings = gpu::settings(&[("noise", "scale", Value::Number(0.0))]);
    settings.without(&["edge_blend".to_owned(), "chromatic_aberration".to_owned()]).unwrap();
    for mut site in sites() {
        let layers = Layers::of(&mut site, &settings, 40);
        let (mut shaded, mut partly) = (0, 0);
        for (i, c) in layers.pixel_channels() {
            // Half a code for rounding.
            let off = layers.deviation(&site, i, c, false);
            assert!(off < 1.0, "{} colour {c} pixel {i}: off by {off:.2}", site.name);
            let (coverage, ratio) = (layers.coverage[i], layers.ratio[c][i]);
            if layers.light[c][i] == 0.0 && coverage == 0.0 && ratio == 1.0 {
                let (out, own) = (layers.composite[3 * i + c], layers.camera[3 * i + c]);
                assert_eq!(out, own, "{} colour {c} pixel {i} is untouched by the layers", site.name);
            }
            shaded += usize::from(ratio < 0.97 && coverage == 0.0);
            partly += usize::from(coverage > 0.05 && coverage < 0.95);
        }
        assert!(shaded > 300 && partly > 100, "{}: {shaded} in a shadow, {partly} partly covered", site.name);
    }
}

#[test]
fn layers_with_their_noise_match_the_composite_with_all_effects() {
    for mut site in sites() {
        let layers = Layers::of(&mut site, &gpu::settings(&[]), 40);
        let (mut largest, mut largest_without, mut noisy) = (0.0f64, 0.0f64, 0);
        for (i, c) in layers.pixel_channels() {
            let off = layers.deviation(&site, i, c, true);
            assert!(off < 1.0, "{} colour {c} pixel {i}: off by {off:.2}", site.name);
            largest = largest.max(off);
            largest_without = largest_without.max(layers.deviation(&site, i, c, false));
            noisy += usize::from(layers.noise[c][i] != 0.0);
            if layers.composite[3 * i + c] == layers.camera[3 * i + c] && layers.ratio[c][i] == 1.0 {
                assert!(layers.coverage[i] > 0.0 || layers.noise[c][i] == 0.0, "{} pixel {i}", site.name);
            }
        }
        println!("{}: off by {largest:.3} codes with noise, {largest_without:.1} without; {noisy} values", site.name);
        assert!(noisy > 1000 && largest_without > 2.0, "{}: {noisy}, {largest_without}", site.name);
    }
}

#[test]
fn noise_scale_changes_no_real_pixel() {
    let mut site = demo_like(&Reduction::by(2).demo());
    let gpu = gpu::gpu();
    let mut compositor = site.shot.compositor(gpu.clone());
    let [none, one, two, eight] = [0.0, 1.0, 2.0, 8.0].map(|scale| {
        let settings = gpu::settings(&[("noise", "scale", Value::Number(scale))]);
        composited(&mut compositor, &mut site, settings, 50)
    });
    let camera = camera(&site, 50);
    let (response, noise) = (&site.shot.rig.response, site.shot.rig.noise.as_ref().unwrap());
    let codes = |done: &Composited| done.pixels.codes.eight_bit().unwrap().to_vec();
    let (with_none, with_one) = (codes(&none), codes(&one));
    let own = camera.pixels.codes.eight_bit().unwrap();
    let layer = one.layer.as_ref().unwrap();
    // Of real pixels in a shadow: squared deviation due to noise, and the variance removed by the
    // shadow.
    let (mut made, mut taken, mut shaded) = (0.0, 0.0, 0);
    for other in [codes(&two), codes(&eight)] {
        let mut virtual_differs = 0;
        for (i, (a, b)) in with_one.iter().zip(&other).enumerate() {
            if layer.rgba[i / 3] == [0.0; 4] {
                assert_eq!(a, b, "value {i}: ratio {:?}", layer.left[i / 3]);
            } else {
                virtual_differs += usize::from(a != b);
            }
        }
        assert!(virtual_differs > 1000, "evidence has the noise that is asked for: {virtual_differs}");
    }
    for (i, (code, clean)) in with_one.iter().zip(&with_none).enumerate() {
        let (pixel, c) = (i / 3, i % 3);
        let ratio = f64::from(layer.left[pixel][c]);
        if layer.rgba[pixel] != [0.0; 4] || ratio == 1.0 {
            continue;
        }
        let before = f64::from(own[i]) / 255.0;
        let after = response.encode(ratio * response.decode(before));
        let slopes = response.slope_at_code(after) / response.slope_at_code(before);
        let brought = ratio * slopes * noise.sigma(c, 255.0 * before);
        let missing = (noise.sigma(c, 255.0 * after).powi(2) - brought.powi(2)).max(0.0);
        if missing > 0.5 {
            made += (f64::from(*code) - f64::from(*clean)).powi(2);
            taken += missing + 2.0 / 12.0;
            shaded += 1;
        }
    }
    assert!(shaded > 300, "{shaded}");
    assert!(
        (made / taken - 1.0).abs() < 0.12,
        "{:.3} of the variance that shadows took, of {shaded} values",
        made / taken
    );
}
