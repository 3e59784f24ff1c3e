//! The layers that a composite writes hold all that it did to the camera's picture, except what the sensor does.

use std::path::Path;

use exr::prelude::read_first_flat_layer_from_file;
use locard::compositor::{Composited, Compositor, IN_FLIGHT, Settings};
use locard::frame::Frame;
use locard::params::Value;
use locard::sink::exr::write_layers;

use crate::gpu;
use crate::site::{NamedShot, demo_like, desk};
use crate::small;
use crate::tier::is_full;

/// A frame of a recording with its evidence.
fn composited(compositor: &mut Compositor, site: &mut NamedShot, settings: Settings, frame: usize) -> Composited {
    site.shot.settings = settings;
    site.shot.frames(compositor, frame..frame + 1, true, IN_FLIGHT).unwrap().next().unwrap().unwrap()
}

/// The camera's own.
fn camera(site: &NamedShot, frame: usize) -> Frame {
    site.shot.recording.frames(frame..frame + 1).unwrap().next().unwrap().unwrap()
}

/// A channel of an OpenEXR file, row by row.
fn channel(file: &Path, name: &str) -> Vec<f32> {
    let image = read_first_flat_layer_from_file(file).unwrap();
    let channels = &image.layer_data.channel_data.list;
    let found = channels.iter().find(|channel| channel.name.to_string() == name);
    found.unwrap_or_else(|| panic!("no channel {name}")).sample_data.values_as_f32().collect()
}

#[test]
fn layers_over_the_cameras_picture_are_the_composite_within_a_code() {
    // The sensor's noise and the blend of edges act on codes, and chromatic aberration parts a pixel's coverage by colour.
    let mut settings = gpu::settings(&[("noise", "scale", Value::Number(0.0))]);
    settings.without(&["edge_blend".to_owned(), "chromatic_aberration".to_owned()]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let gpu = gpu::gpu();
    for mut site in [Some(demo_like(&small::demo(2))), desk().filter(|_| is_full())].into_iter().flatten() {
        let mut compositor = site.shot.compositor(gpu.clone());
        let (done, camera) = (composited(&mut compositor, &mut site, settings.clone(), 40), camera(&site, 40));
        let file = folder.path().join(format!("{}.exr", site.name));
        write_layers(&file, done.layer.as_ref().unwrap(), false).unwrap();
        let coverage = channel(&file, "virtual.A");
        let response = &site.shot.rig.response;
        let (mut shaded, mut partly) = (0, 0);
        for (c, color) in ["R", "G", "B"].into_iter().enumerate() {
            let light = channel(&file, &format!("virtual.{color}"));
            let ratio = channel(&file, &format!("shadow.{color}"));
            let codes = |frame: &locard::pixels::Pixels| -> Vec<u8> {
                frame.codes.eight_bit().unwrap().iter().skip(c).step_by(3).copied().collect()
            };
            for (i, (out, own)) in codes(&done.pixels).into_iter().zip(codes(&camera.pixels)).enumerate() {
                let real = response.decode(f64::from(own) / 255.0);
                let over = f64::from(light[i]) + f64::from((1.0 - coverage[i]) * ratio[i]) * real;
                let expected = (255.0 * response.encode(over.max(0.0))).min(255.0);
                // Half a code for rounding.
                let off = (f64::from(out) - expected).abs();
                assert!(off < 1.0, "{} {color} pixel {i}: {out}, by the layers {expected:.2}", site.name);
                if light[i] == 0.0 && coverage[i] == 0.0 && ratio[i] == 1.0 {
                    assert_eq!(out, own, "{} {color} pixel {i} is untouched by the layers", site.name);
                }
                shaded += usize::from(ratio[i] < 0.97 && coverage[i] == 0.0);
                partly += usize::from(coverage[i] > 0.05 && coverage[i] < 0.95);
            }
        }
        assert!(shaded > 300 && partly > 100, "{}: {shaded} in a shadow, {partly} partly covered", site.name);
    }
}

#[test]
fn noise_scale_changes_no_real_pixel() {
    let mut site = demo_like(&small::demo(2));
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
    // Of real pixels in a shadow: squared deviation that noise makes, and the variance that the shadow took.
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
