//! Particulars of a photograph, as a photographer logs them: settings, subject, objects in view.
//! They are the value `photograph` of the record beside the photograph's file.

use serde::{Deserialize, Serialize};

use super::card::CaseCard;
use crate::scene::ObjectKind;

/// Share of the film's diagonal up to which a circle of confusion counts as sharp: 0.029 mm on
/// 36×24.
pub const SHARP_CIRCLE_SHARE: f64 = 1.0 / 1500.0;

/// Particulars of one photograph.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Particulars {
    /// Number in the series, from 1.
    pub number: u32,
    /// Date and time on the camera's clock, `2026-11-30 12:34:56`.
    pub taken: String,
    #[serde(flatten)]
    pub content: PhotoContent,
}

/// Content of a photograph.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PhotoContent {
    /// A case card.
    Card(CaseCard),
    /// A view of the scene.
    View(Box<ViewParticulars>),
}

/// Particulars of a view of the scene.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ViewParticulars {
    /// The recording, as it was named.
    pub recording: String,
    /// Frame of the recording, from 0.
    pub frame: usize,
    pub width_px: u32,
    pub height_px: u32,
    pub focal_length_mm: f64,
    /// Focal length with the same angle of view on 36×24 mm.
    pub equivalent_mm: f64,
    /// Engraved values, as a camera writes them.
    pub f_number: f64,
    pub shutter_s: f64,
    pub iso: f64,
    pub support: CameraSupport,
    /// Stops brighter than correct, that is than a mean of 18 %.
    pub exposure_deviation_ev: f64,
    /// Share of the pixels with a clipped channel, 0 to 1.
    pub clipped_share: f64,
    /// `None` for infinity.
    pub focus_distance_m: Option<f64>,
    /// Limits of the depth of field for circles of confusion of 1/1500 of the film's diagonal.
    pub sharp_from_m: f64,
    /// `None` for infinity.
    pub sharp_to_m: Option<f64>,
    /// The subject; `None` if no evidence or marker is in view.
    pub subject: Option<Subject>,
    /// All objects of the scene that are not hidden, in its order, also those out of view.
    pub objects: Vec<ObjectInView>,
}

/// Support of the camera while the shutter is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraSupport {
    Tripod,
    HandHeld,
}

/// The subject of a photograph.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Subject {
    /// Name of the object.
    pub name: String,
    /// True if the photographer named it, by `--subject` or `--aim`. Otherwise it is the evidence
    /// or marker nearest to the picture's centre.
    pub is_named: bool,
    /// Distance from the camera to the object's centre.
    pub distance_m: f64,
    /// Angle between the optical axis and the normal of the subject's plane, degrees, 0 to 90: 0 is
    /// square to the plane. The optical axis is the normal of the picture's plane.
    pub angle_deg: f64,
    /// At the object's centre, across the optical axis.
    pub mm_per_px: f64,
    /// Largest circle of confusion on the subject, px of the photograph.
    pub defocus_px: f64,
    /// Length of its path in the picture while the shutter is open, px; `None` without poses then.
    pub motion_px: Option<f64>,
    /// Share of the clipped pixels in the subject's bounds, 0 to 1.
    pub clipped_share: f64,
    /// The scale in view that is nearest to the subject.
    pub scale: Option<ScaleInView>,
}

/// A scale in view, relative to the subject's plane.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ScaleInView {
    /// Name of the object.
    pub name: String,
    /// Angle between its plane and the subject's, degrees, 0 to 90.
    pub tilt_deg: f64,
    /// Relative error of measurements by its tilt: 1/cos − 1.
    /// `None` if the scale is on edge, and infinite.
    pub tilt_error: Option<f64>,
    /// Height of its centre over the subject's plane, towards the camera, metres.
    pub height_m: f64,
    /// Relative error of measurements by its height: −height / distance.
    pub height_error: f64,
}

/// An object in a photograph. Occlusion by the real site is not considered.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct ObjectInView {
    pub name: String,
    pub kind: ObjectKind,
    /// Longest side of its bounding box, metres.
    pub size_m: f64,
    /// Centre of its bounding box in the recording's world, metres.
    pub centre_m: [f64; 3],
    /// Distance from the camera to its centre.
    pub distance_m: f64,
    /// At its centre, across the optical axis. 0 behind the camera.
    pub mm_per_px: f64,
    /// Share of the picture that it covers, 0 to 1.
    pub share: f64,
    /// Share of its outline in the picture: 0 is out of view, 1 wholly in view.
    pub in_view: f64,
    /// Bounds of its part in view, px: left, top, right, bottom. All 0 out of view.
    pub bounds_px: [f64; 4],
}

impl ObjectInView {
    /// Longest side of its bounds in view, px.
    pub fn longest_px(&self) -> f64 {
        let [left, top, right, bottom] = self.bounds_px;
        (right - left).max(bottom - top)
    }

    /// True if all of it is in the picture.
    pub fn is_whole(&self) -> bool {
        self.in_view >= 1.0
    }
}

impl ViewParticulars {
    /// The object of this name.
    pub fn object(&self, name: &str) -> Option<&ObjectInView> {
        self.objects.iter().find(|object| object.name == name)
    }

    /// Scales of which at least this share is in view.
    pub fn scales(&self, min_in_view: f64) -> impl Iterator<Item = &ObjectInView> {
        let is_in_view = move |object: &&ObjectInView| object.in_view > 0.0 && object.in_view >= min_in_view;
        self.objects.iter().filter(|object| object.kind == ObjectKind::Scale).filter(is_in_view)
    }
}
