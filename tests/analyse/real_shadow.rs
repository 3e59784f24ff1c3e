//! Evidence in a real shadow: the floor's light is not reduced twice, and the evidence is as dark
//! as its surroundings.

use std::path::Path;

use crate::program::stdout_of;
use crate::tier::fast_or_full;
use crate::truth::{size, small_site};
use locard::pixels::Pixels;

const FRAME: usize = 6;
/// Position on the floor where a stool's seat occludes the lamp.
const IN_SHADOW: [f64; 2] = [0.06, -0.12];

fn codes(path: &str) -> Vec<[f64; 3]> {
    let image = image::open(Path::new(path)).unwrap().to_rgb8();
    let pixels = Pixels::from_u8(image.width(), image.height(), image.into_raw()).unwrap();
    pixels.codes.to_eight_bit().as_chunks().0.iter().map(|codes: &[u8; 3]| codes.map(f64::from)).collect()
}

/// Mean difference in codes between two pictures, over the selected pixels.
fn mean_difference(a: &[[f64; 3]], b: &[[f64; 3]], counts: impl Fn(usize) -> bool) -> f64 {
    let off: Vec<f64> = (0..a.len()).filter(|i| counts(*i)).map(|i| a[i][1] - b[i][1]).collect();
    assert!(off.len() > fast_or_full(50, 200), "{}", off.len());
    off.iter().sum::<f64>() / off.len() as f64
}

/// A site with one lamp at its side, whose light is known.
// Slow: two simulated sites and a composite with shadows.
#[test]
fn real_shadow_is_not_darkened_twice_and_darkens_evidence() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb");
    let [x, y] = IN_SHADOW;
    // The truth of site 8: its lamp, and the remaining light on the middle of the floor.
    let light = "[light]\nambient = [0.4, 0.439, 0.468]\n[[light.lamp]]\nat_m = [1.5976, -0.7469, 1.9565]\n\
                 color = [2.8671, 3.1359, 3.4047]\ndiameter_m = 0.1\n";
    let object = format!("version = 1\nup = \"z\"\n[[objects]]\nmodel = {model:?}\nposition_m = [{x}, {y}, 0]\n");
    std::fs::write(path("evidence.toml"), &object).unwrap();
    std::fs::write(path("lit.toml"), format!("{object}{light}")).unwrap();
    let simulated = |name: &str, more: &[&str]| small_site(8, &path(name), more);
    simulated("empty", &[]);
    simulated("there", &["--evidence", &path("evidence.toml")]);
    let text = std::fs::read_to_string(path("there/truth.toml")).unwrap();
    assert!(text.contains("lamps_at_m = [[1.5976, -0.7469, 1.9565]]"), "{text}");
    let composited = |out: &str, more: &[&str]| {
        let (recording, scene, to, range) =
            (path("empty"), path("lit.toml"), path(out), format!("{FRAME}..{}", FRAME + 1));
        let base = ["composite", &recording, "--scene", &scene, "--quiet", "--frames", &range, "-o", &to];
        stdout_of(&[&base[..], more].concat());
        codes(&format!("{to}/frame_{FRAME:06}.png"))
    };
    let [empty, there] = ["empty", "there"].map(|name| codes(&path(&format!("{name}/rgb/{FRAME:05}.png"))));
    let (made, unshaded) = (composited("made", &[]), composited("unshaded", &["--set", "shadow.cast=false"]));
    let differs = |a: &[[f64; 3]], b: &[[f64; 3]], i: usize, by: f64| (0..3).any(|c| (a[i][c] - b[i][c]).abs() > by);
    let is_thing = |i: usize| differs(&unshaded, &empty, i, 8.0);
    // Pixels that either picture shades, away from the marker's edge.
    let near_thing = |i: usize| {
        [i.wrapping_sub(1), i + 1, i.wrapping_sub(size().0), i + size().0]
            .into_iter()
            .any(|n| n < empty.len() && is_thing(n))
    };
    let is_shaded = |i: usize| {
        !is_thing(i) && !near_thing(i) && (differs(&made, &empty, i, 1.0) || differs(&there, &empty, i, 6.0))
    };
    let (floor, thing) = (mean_difference(&made, &there, is_shaded), mean_difference(&made, &there, is_thing));
    let lit = mean_difference(&unshaded, &there, is_thing);
    println!("floor {floor:.2} codes brighter than the truth, marker {thing:.2}; lit by the lamp {lit:.2}");
    assert!(floor.abs() < 3.0, "{floor}");
    // The rest is the scene's ambient light, part of which the seat occludes too.
    assert!(thing < 45.0 && lit > thing + 12.0, "{thing} {lit}");
}
