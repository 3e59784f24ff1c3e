//! The text file beside an exported camera: sizes, axes, lens, and the steps to load it.

use std::fmt::Write;

use glam::DMat3;

use super::format::CameraFormat;
use super::plate::Plate;
use super::shot_camera::ShotCamera;
use crate::text::{count, fixed, short};

/// Contents of an export.
pub struct ReadmeFacts<'a> {
    pub name: &'a str,
    pub camera: &'a ShotCamera,
    pub plates: &'a [(CameraFormat, &'a Plate)],
    /// The plate of the ST maps.
    pub mapped: Option<&'a Plate>,
    /// File names of the maps of the first lens: undistort, redistort.
    pub map_files: &'a [String; 2],
    pub object_count: usize,
    pub are_poses_refined: bool,
    pub has_even_times: bool,
}

/// Text of `README.txt`.
pub fn write(facts: &ReadmeFacts<'_>) -> String {
    let camera = facts.camera;
    let recorded = &camera.lenses[0].intrinsics;
    let [first, last] =
        [camera.frames.first(), camera.frames.last()].map(|frame| frame.map_or(0, |frame| frame.number));
    let mut text = format!(
        "Camera of the recording {}, exported by Locard\n\n\
         Frames      {first} to {last}, {} per second (nominal); frames.csv has the picture and the time of each\n\
         Poses       {} of {}, {}; each is that of the middle row at the middle of its exposure\n\
         Recorded    {} x {} px\n",
        facts.name,
        short(camera.fps),
        camera.posed().count(),
        count(camera.frames.len(), "frame"),
        if facts.are_poses_refined { "refined by an analysis" } else { "as recorded" },
        recorded.width_px,
        recorded.height_px,
    );
    if recorded.readout_time_s > 0.0 {
        let _ = writeln!(
            text,
            "Readout     {} ms from the first row to the last: in motion, rows above and below the middle have other \
             poses, which a single pose per frame does not show",
            short(1e3 * recorded.readout_time_s)
        );
    }
    if facts.object_count > 0 {
        let _ = writeln!(
            text,
            "Evidence    {}, in .usda and .glb; lights are not exported",
            count(facts.object_count, "object")
        );
    }
    for (format, plate) in facts.plates {
        let _ = write!(text, "\n{}\n", format.file_name());
        let _ = writeln!(text, "  Render at   {} x {} px, square pixels", plate.width_px, plate.height_px);
        if plate.is_recorded {
            text.push_str("  The render lies over the recorded pictures pixel by pixel.\n");
        } else {
            text.push_str("  The render is undistorted and larger than the recorded pictures; see ST maps.\n");
        }
        match format {
            CameraFormat::Chan => {
                // The apertures of USD.
                let mm_per_px = recorded.film_width_mm / f64::from(recorded.width_px);
                let _ = write!(
                    text,
                    "  Nuke        set horiz aperture {} and vert aperture {} before Import chan file: the file has the\n              \
                     vertical field of view, and Nuke derives the focal length from the vertical aperture\n  \
                     Columns     frame tx ty tz rx ry rz vfov; metres, degrees; rotation order ZXY (z first)\n",
                    fixed(mm_per_px * f64::from(plate.width_px), 6),
                    fixed(mm_per_px * f64::from(plate.height_px), 6),
                );
            }
            CameraFormat::Usda => {
                text.push_str(
                    "  Time codes are frame numbers. The camera is /World/Camera, the evidence is below /World/Evidence.\n  \
                     Focal length and apertures are in tenths of the unit, which is the metre.\n",
                );
            }
            CameraFormat::Gltf => {
                let _ = write!(
                    text,
                    "  Times are seconds from the recording's first frame on, {}. At {} frames per second frame {first} of\n  \
                     frames.csv is frame {} from 0.\n",
                    if facts.has_even_times { "at a constant rate" } else { "by the frames' timestamps" },
                    short(camera.fps),
                    camera.frames.first().map_or_else(String::new, |frame| short((frame.time_s * camera.fps).round())),
                );
            }
        }
    }
    if let Some(plate) = facts.mapped {
        let [undistort, redistort] = facts.map_files;
        let (w, h) = (plate.width_px, plate.height_px);
        let _ = write!(
            text,
            "\nST maps ({}; S in red to the right, T in green upwards, the centre of pixel x of w at (x + 0.5)/w)\n  \
             {undistort}   {w} x {h} px: recorded picture in, undistorted plate out\n  \
             {redistort}   {} x {} px: undistorted plate or render in, recorded picture out\n  \
             Lens of the plate: focal length {} px, principal point in the centre, no distortion\n  \
             Nuke        STMap: the map into input stmap, the picture into src; uv channels rgb, filter as needed\n",
            if camera.lenses.len() > 1 { "one pair per frame" } else { "32-bit float OpenEXR" },
            recorded.width_px,
            recorded.height_px,
            fixed(plate.lenses[0].focal_px.x, 6),
        );
    }
    let m = DMat3::from_quat(camera.file_from_world);
    let row = |i: usize| m.row(i).to_array().map(|value| fixed(value, 9)).join(" ");
    let up = camera.up.to_array().map(|value| fixed(value, 6)).join(" ");
    let _ = write!(
        text,
        "\nAxes\n  World       metres, y up; file = R · recording, with R, row by row\n              {}\n              {}\n              {}\n  \
         Up          {up} in the recording{}\n  Camera      x right, y up, looks along -z\n",
        row(0),
        row(1),
        row(2),
        if camera.is_up_known { "" } else { ", the mean of the cameras' own, since the recording does not state it" },
    );
    text
}
