//! Ground truth of a simulated recording: truth.toml, the true values where the recording is
//! flawed, and number formatting.
//!
//! Names, signs and axes are those of an analysis, so both can be compared key by key.

use glam::DVec3;
use toml_edit::{DocumentMut, Item, Table, Value};

use crate::camera::{NoiseBin, NoiseProfile};
use crate::document::{numbers, table_of};
use crate::params::Params;
use crate::pose::Pose;
use crate::profile;
use crate::tracking::PoseTrack;

use super::depth::phone_from_site;
use super::lamps::{CENTRE_M, DEMO_LAMP};
use super::manifest::{Manifest, sealed};
use super::{FolderLayout, Simulation, board};

/// Ground-truth files of a recording with flaws.
pub const FOLDER: &str = "truth";
pub const POSES: &str = "truth/poses.txt";
pub const FRAMES: &str = "truth/frames.txt";

/// List of the error-free depth maps, if the depth has sensor errors.
pub const DEPTHS: &str = "truth/depth.txt";

/// File name of a frame's exact depth map.
pub fn depth_name(frame: usize) -> String {
    format!("depth-{frame:05}.png")
}

/// The camera's true trajectory in the recording's world, and the gains of each frame.
pub fn files(simulation: &Simulation) -> (PoseTrack, String) {
    let track = match simulation.options().layout {
        Some(FolderLayout::Stray) => simulation.track().in_world(&Pose::new(phone_from_site().inverse(), DVec3::ZERO)),
        None => simulation.track().clone(),
    };
    let line = |frame: usize| {
        let [r, g, b] = simulation.gains(frame);
        let (time_s, picture) = (simulation.timestamp_s(frame), simulation.flaws().source_frame(frame));
        format!("{frame} {time_s} {r} {g} {b} {picture}\n")
    };
    let head = "# frame timestamp red green blue: factors on light; then the frame whose picture it has\n";
    (track, (0..simulation.options().frames as usize).fold(head.to_owned(), |text, frame| text + &line(frame)))
}

/// True values of the quantities in analysis.toml.
fn true_numbers(simulation: &Simulation) -> Table {
    let flaws = simulation.flaws();
    let (way_m, turn) = flaws.hand_eye();
    let numbers = [
        ("clock_s", flaws.poses_later_s),
        ("depth_later_s", flaws.depth_later_s),
        ("readout_time_s", simulation.geometry().intrinsics.readout_time_s),
        ("exposure_s", simulation.options().exposure_time_s),
    ];
    let mut table: Table = numbers.into_iter().map(|(name, value)| (name, Value::from(value))).collect();
    let turn_deg = turn.to_array().map(f64::to_degrees);
    for (name, values) in [("hand_eye_way_m", way_m.to_array()), ("hand_eye_turn_deg", turn_deg)] {
        // Avoids −0.
        table.insert(name, Item::Value(numbers_in(values.map(|v| v + 0.0), 9)));
    }
    table
}

/// Lamp positions and irradiance from above, of a site with its own lamps.
fn true_light(simulation: &Simulation) -> Table {
    let lamps = simulation.lamps();
    let all = |of: fn(&(DVec3, DVec3)) -> DVec3| -> Value {
        let values = lamps.iter().map(|lamp| numbers_in(of(lamp).to_array(), 4));
        Value::Array(values.collect())
    };
    Table::from_iter([
        ("at_m", numbers_in(CENTRE_M.to_array(), 3)),
        ("upward", numbers_in(simulation.white_facing_up(CENTRE_M).to_array(), 4)),
        ("lamps_at_m", all(|lamp| lamp.0)),
        ("lamps_shown_at_1_m", all(|lamp| lamp.1)),
    ])
}

/// Rounds to a number of decimal digits, such as micrometres and nanoseconds.
pub fn rounded(value: f64, digits: usize) -> f64 {
    // Formatting as text rounds correctly at every magnitude.
    format!("{value:.digits$}").parse().unwrap_or(value)
}

fn numbers_in(values: impl IntoIterator<Item = f64>, digits: usize) -> Value {
    numbers(values.into_iter().map(|v| rounded(v, digits)))
}

/// Rounded to a thousandth of a code, finer than the measurement.
pub fn rounded_noise(noise: &NoiseProfile) -> NoiseProfile {
    let bin = |bin: &NoiseBin| NoiseBin { code: rounded(bin.code, 1), sigma: rounded(bin.sigma, 3) };
    NoiseProfile {
        example: None,
        bins: noise.bins.each_ref().map(|bins| bins.iter().map(bin).collect()),
        channel_correlation: noise.channel_correlation.map(|v| rounded(v, 3)),
        neighbour_correlation: noise.neighbour_correlation.map(|v| rounded(v, 3)),
    }
}

/// A table with a comment above it.
fn commented(mut table: Table, comment: &str) -> Item {
    table.decor_mut().set_prefix(if comment.is_empty() { "\n".to_owned() } else { format!("\n# {comment}\n") });
    Item::Table(table)
}

/// The text of truth.toml, sealed. `blur`: [`super::SimulatedPicture::max_blur_px`], one per frame.
pub fn truth_toml(simulation: &Simulation, blur: &[f64], written: &Manifest) -> String {
    let mut text = DocumentMut::new();
    text.insert("version", toml_edit::value(1));
    text.insert("most_blur_px", Item::Value(numbers_in(blur.iter().copied(), 2)));
    let comments = [
        ("version", "# How this recording was made.\n"),
        (
            "most_blur_px",
            "\n# The longest way that anything takes across the picture during a row's exposure, a frame each.\n",
        ),
    ];
    for (key, comment) in comments {
        if let Some(mut key) = text.key_mut(key) {
            key.leaf_decor_mut().set_prefix(comment);
        }
    }
    let options = simulation.options();
    text.insert(options.table(), commented(table_of(options), ""));
    let flaws = simulation.flaws();
    if flaws.is_any() {
        text.insert(flaws.table(), commented(table_of(flaws), "What is wrong with it."));
        let comment = "What is true of it, in the words of an analysis; more in truth/.";
        text.insert("truth", commented(true_numbers(simulation), comment));
    }
    match options.lamps {
        None => {
            let values = [
                ("centre_m", numbers_in(DEMO_LAMP.centre_m.to_array(), 3)),
                ("half_size_m", numbers_in(DEMO_LAMP.half_extents_m(), 3)),
                ("radiance", numbers_in(DEMO_LAMP.radiance.to_array(), 3)),
            ];
            let comment =
                "The only lamp: a rectangle in the ceiling that shines down; linear light, 1 is camera white.";
            text.insert("lamp", commented(values.into_iter().collect(), comment));
        }
        Some(_) => {
            text.insert(
                "light",
                commented(true_light(simulation), "What white matt shows that looks up in the middle; linear light."),
            );
        }
    }
    let before_file = profile::noise_table(&rounded_noise(&simulation.sensor.profile()), std::path::Path::new(""));
    text.insert("noise_before_file", commented(before_file, "σ before rounding and compression."));
    if !simulation.evidence().is_empty() {
        let names = simulation.evidence().iter().map(Value::from).collect();
        let evidence = Table::from_iter([("objects", Value::Array(names))]);
        text.insert("evidence", commented(evidence, "What really lies in the site."));
    }
    if options.board {
        let corners = board().corners_in_world_m.map(|corner| numbers_in(corner.to_array(), 4));
        let board = Table::from_iter([("corners_in_world_m", Value::Array(corners.into_iter().collect()))]);
        text.insert("board", commented(board, ""));
    }
    let comment = "Length, bytes, and crc32 of the other files: what differs is not replaced.";
    text.insert("files", commented(written.table(), comment));
    sealed(&text.to_string())
}
