//! Checks of a series by item: each item needs an overview, a mid-range photograph, a close-up
//! without a scale, and one with a scale, square to the plane.

use glam::DVec3;

use super::checks::{MAX_SCALE_TILT_DEG, MAX_VIEW_ANGLE_DEG, MIN_LENGTH_PX};
use super::finding::{Check, Finding};
use super::shot_class::ShotClass;
use crate::photo::particulars::{ObjectInView, ViewParticulars};
use crate::scene::ObjectKind;
use crate::text::fixed;

/// A marker within this distance of evidence numbers it, m.
const MARKER_REACH_M: f64 = 0.5;
/// Smallest share of an item in view, for an overview.
const MIN_OVERVIEW_IN_VIEW: f64 = 0.5;

/// An item of a series and the numbers of its photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ItemCoverage {
    /// Name of the object.
    pub name: String,
    /// The marker beside it.
    pub marker: Option<String>,
    pub overviews: Vec<u32>,
    pub mid_ranges: Vec<u32>,
    /// Close-ups with no scale in view.
    pub close_ups: Vec<u32>,
    /// Close-ups with a scale, square to the plane, the scale in it.
    pub with_scale: Vec<u32>,
    /// Close-ups with a scale that are not square, or whose scale lies in another plane, and the
    /// larger of both angles, degrees.
    pub not_square: Vec<(u32, f64)>,
    pub findings: Vec<Finding>,
}

impl ItemCoverage {
    /// Name with the marker's.
    pub fn title(&self) -> String {
        self.marker.as_ref().map_or_else(|| self.name.clone(), |marker| format!("{} ({marker})", self.name))
    }
}

/// The items of a series and their coverage: all evidence of the scene, and markers without
/// evidence beside them, in the order in which photographs list them.
pub fn item_coverage(views: &[(u32, &ViewParticulars)]) -> Vec<ItemCoverage> {
    let mut objects: Vec<&ObjectInView> = Vec::new();
    for object in views.iter().flat_map(|(_, view)| &view.objects) {
        if !objects.iter().any(|other| other.name == object.name) {
            objects.push(object);
        }
    }
    let of_kind = |kind: ObjectKind| objects.iter().copied().filter(move |object| object.kind == kind);
    let apart_m = |a: &ObjectInView, b: &ObjectInView| DVec3::from(a.centre_m).distance(DVec3::from(b.centre_m));
    let nearest_marker = |item: &ObjectInView| {
        let near = of_kind(ObjectKind::Marker).filter(|marker| apart_m(marker, item) <= MARKER_REACH_M);
        near.min_by(|a, b| apart_m(a, item).total_cmp(&apart_m(b, item))).map(|marker| marker.name.clone())
    };
    let evidence = of_kind(ObjectKind::Evidence).map(|item| ItemCoverage {
        name: item.name.clone(),
        marker: nearest_marker(item),
        ..ItemCoverage::default()
    });
    let has_evidence =
        |marker: &ObjectInView| of_kind(ObjectKind::Evidence).any(|item| apart_m(marker, item) <= MARKER_REACH_M);
    let alone = of_kind(ObjectKind::Marker)
        .filter(|marker| !has_evidence(marker))
        .map(|marker| ItemCoverage { name: marker.name.clone(), ..ItemCoverage::default() });
    let mut items: Vec<ItemCoverage> = evidence.chain(alone).collect();
    for item in &mut items {
        views.iter().for_each(|(number, view)| item.add(*number, view));
        item.findings = item.missing();
    }
    items
}

impl ItemCoverage {
    /// Counts a photograph for the item.
    fn add(&mut self, number: u32, view: &ViewParticulars) {
        let Some(object) = view.object(&self.name) else { return };
        match ShotClass::of(view, object) {
            Some(ShotClass::Overview) if object.in_view >= MIN_OVERVIEW_IN_VIEW => self.overviews.push(number),
            Some(ShotClass::MidRange) if object.is_whole() => self.mid_ranges.push(number),
            Some(ShotClass::CloseUp) if object.is_whole() && object.longest_px() >= MIN_LENGTH_PX => {
                self.add_close_up(number, view);
            }
            _ => {}
        }
    }

    fn add_close_up(&mut self, number: u32, view: &ViewParticulars) {
        if view.scales(0.0).next().is_none() {
            self.close_ups.push(number);
            return;
        }
        // The angles are known for the subject alone.
        let Some(subject) = view.subject.as_ref().filter(|subject| subject.name == self.name) else { return };
        let Some(scale) = &subject.scale else { return };
        if subject.angle_deg <= MAX_VIEW_ANGLE_DEG && scale.tilt_deg <= MAX_SCALE_TILT_DEG {
            self.with_scale.push(number);
        } else {
            self.not_square.push((number, subject.angle_deg.max(scale.tilt_deg)));
        }
    }

    fn missing(&self) -> Vec<Finding> {
        let title = self.title();
        let aim = format!("`--aim \"{}\"`", self.name);
        let mut findings = Vec::new();
        let mut lacks = |check: Check, lack: &str, remedy: String| {
            findings.push(Finding::new(check, format!("{title} has no {lack}"), remedy));
        };
        if self.overviews.is_empty() {
            let remedy = "photograph the whole scene from its corners, with a short lens, the item in view";
            lacks(Check::NoOverview, "overview", remedy.to_owned());
        }
        if self.mid_ranges.is_empty() {
            let remedy = format!("show the item with its surroundings and a fixed point, as with {aim} and `--across`");
            lacks(Check::NoMidRange, "mid-range photograph", remedy);
        }
        if self.close_ups.is_empty() {
            let remedy = format!(
                "fill the picture with the item, at {} px or more, before a scale is laid beside it ({aim})",
                fixed(MIN_LENGTH_PX, 0)
            );
            lacks(Check::NoCloseUp, "close-up without scale", remedy);
        }
        if self.with_scale.is_empty() && self.not_square.is_empty() {
            let remedy = format!(
                "lay a scale into the item's plane and photograph both at 90°, item named by `--subject \"{}\"`",
                self.name
            );
            lacks(Check::NoCloseUpWithScale, "close-up with scale", remedy);
        }
        if let (true, Some((number, angle_deg))) = (self.with_scale.is_empty(), self.not_square.first()) {
            findings.push(Finding::new(
                Check::CloseUpNotSquare,
                format!(
                    "{title}: none of its close-ups with scale ({}) is square to the plane with the scale in it: number \
                     {number} is {}° off",
                    self.not_square.len(),
                    fixed(*angle_deg, 0)
                ),
                "photograph it once more from the normal of its plane; without that no length can be taken from the \
                 picture",
            ));
        }
        findings
    }
}
