//! Checks of single photographs.

use super::finding::{Check, Finding};
use super::shot_class::ShotClass;
use crate::camera::stops::{
    Step, format_f_number, format_iso, format_shutter_s, iso_speeds, marked, nearest, shutter_times_s,
};
use crate::photo::particulars::{
    CameraSupport, ObjectInView, SHARP_CIRCLE_SHARE, ScaleInView, Subject, ViewParticulars,
};
use crate::photo::plane_view::foreshortening;
use crate::scene::ObjectKind;
use crate::text::fixed;

/// Exposure deviations from this one on are reported, stops: two clicks of a third, and rounding.
const MAX_DEVIATION_EV: f64 = 0.65;
/// Largest clipped shares of the subject's bounds and of the picture.
const MAX_CLIPPED_SUBJECT: f64 = 0.01;
const MAX_CLIPPED_PICTURE: f64 = 0.05;
/// Tolerance of the rule of one over the focal length: engraved times are rounded.
const HAND_HELD_TOLERANCE: f64 = 1.05;
/// Largest angle between the optical axis and the normal of a close-up's plane, degrees: lengths
/// appear up to 1.5 % short.
pub const MAX_VIEW_ANGLE_DEG: f64 = 10.0;
/// Largest tilt of a scale, degrees: 0.4 %.
pub const MAX_SCALE_TILT_DEG: f64 = 5.0;
/// Largest error by a scale's height over the subject's plane.
const MAX_HEIGHT_ERROR: f64 = 0.01;
/// Shortest scale or item of a close-up, px: read to half a pixel at both ends, its length is
/// uncertain by up to 1 %.
pub const MIN_LENGTH_PX: f64 = 100.0;
/// Smallest share of a side of the picture that a close-up's subject covers, without a scale and
/// together with it.
pub const MIN_SUBJECT_SHARE: f64 = 0.25;
const MIN_WITH_SCALE_SHARE: f64 = 0.5;
/// Longest path of the subject while the shutter is open, px, if the picture is small.
const MIN_MOTION_LIMIT_PX: f64 = 2.0;
/// Smallest visible circle of confusion, px.
const MIN_CIRCLE_PX: f64 = 1.0;

/// Faults of a photograph of the scene.
pub fn view_findings(view: &ViewParticulars) -> Vec<Finding> {
    let mut findings = Vec::new();
    findings.extend(exposure(view));
    findings.extend(clipped(view));
    let subject = view.subject.as_ref().and_then(|subject| Some((subject, view.object(&subject.name)?)));
    findings.extend(shutter(view, subject.map(|(subject, _)| subject)));
    let Some((subject, object)) = subject else { return findings };
    let class = ShotClass::of(view, object);
    if class.is_none() {
        findings.push(cut_off(subject, object));
    }
    if matches!(class, Some(ShotClass::CloseUp | ShotClass::MidRange)) {
        findings.extend(focus(view, subject));
        findings.extend((!object.is_whole()).then(|| cut_off(subject, object)));
    }
    if class == Some(ShotClass::MidRange) {
        findings.extend(fixed_point(view, object));
    }
    if class == Some(ShotClass::CloseUp) {
        findings.extend(tilted(subject));
        findings.extend(subject.scale.iter().flat_map(|scale| scale_findings(view, subject, scale)));
        findings.extend(too_small(view, subject, object));
    }
    findings
}

/// Blur up to this is invisible, px.
fn blur_limit_px(view: &ViewParticulars, floor_px: f64) -> f64 {
    let diagonal_px = f64::from(view.width_px).hypot(f64::from(view.height_px));
    (SHARP_CIRCLE_SHARE * diagonal_px).max(floor_px)
}

fn percent(share: f64) -> String {
    fixed(100.0 * share, 1)
}

fn engraved(shutter_s: f64) -> String {
    let times = shutter_times_s(Step::Third);
    format_shutter_s(nearest(&times, shutter_s).map_or(shutter_s, |stop| marked(&times, stop.exact)))
}

fn exposure(view: &ViewParticulars) -> Option<Finding> {
    let off_ev = view.exposure_deviation_ev;
    if off_ev.abs() < MAX_DEVIATION_EV {
        return None;
    }
    let side = if off_ev > 0.0 { "over" } else { "under" };
    let shutter_s = view.shutter_s / off_ev.exp2();
    Some(Finding::new(
        Check::Exposure,
        format!("{side}exposed by {} stops", fixed(off_ev.abs(), 1)),
        format!(
            "take it with {} at {} and ISO {}, or change aperture or film speed by as much; check the histogram",
            engraved(shutter_s),
            format_f_number(view.f_number),
            fixed(view.iso, 0)
        ),
    ))
}

fn clipped(view: &ViewParticulars) -> Option<Finding> {
    // In a photograph without a named subject, only the clipping of the whole picture counts.
    let named = view.subject.as_ref().filter(|subject| subject.is_named);
    let of_subject = named.map_or(0.0, |subject| subject.clipped_share);
    if of_subject < MAX_CLIPPED_SUBJECT && view.clipped_share < MAX_CLIPPED_PICTURE {
        return None;
    }
    Some(Finding::new(
        Check::ClippedHighlights,
        format!(
            "highlights are clipped: {} % of the subject's area, {} % of the picture",
            percent(of_subject),
            percent(view.clipped_share)
        ),
        "expose a stop less, or turn lamp and camera until the reflection leaves the subject; clipped tones cannot be \
         recovered",
    ))
}

/// Engraved film speed and time of at most `longest_s` of a right exposure; `None` if the series
/// have none.
fn hand_held_settings(view: &ViewParticulars, longest_s: f64) -> Option<String> {
    let speeds = iso_speeds(Step::Third);
    let half_click = (1.0 / 6f64).exp2();
    let speed_times_s = view.iso * view.shutter_s / view.exposure_deviation_ev.exp2();
    let times = shutter_times_s(Step::Third);
    let time = times.iter().filter(|time| time.marked <= HAND_HELD_TOLERANCE * longest_s).find(|time| {
        // A bright scene takes a shorter time than the rule's, since no speed is lower.
        speed_times_s / time.exact * half_click >= speeds.first().map_or(0.0, |lowest| lowest.exact)
    })?;
    let speed = speed_times_s / time.exact;
    let is_too_dark = speed > speeds.last()?.exact * half_click;
    let speed = nearest(&speeds, speed).filter(|_| !is_too_dark)?;
    Some(format!("{} for {}", format_iso(speed.exact), format_shutter_s(time.exact)))
}

fn shutter(view: &ViewParticulars, subject: Option<&Subject>) -> Option<Finding> {
    let motion_px = subject.and_then(|subject| subject.motion_px);
    let moved = motion_px.map_or(String::new(), |px| format!("; the subject moved by {} px", fixed(px, 1)));
    let longest_s = 1.0 / view.equivalent_mm;
    let by_hand = view.support == CameraSupport::HandHeld;
    if by_hand && view.shutter_s > HAND_HELD_TOLERANCE * longest_s {
        return Some(Finding::new(
            Check::ShutterByHand,
            format!(
                "{} by hand: at {} mm (equivalent on 36×24) expect shake from 1/{} s on{moved}",
                format_shutter_s(view.shutter_s),
                fixed(view.equivalent_mm, 0),
                fixed(view.equivalent_mm, 0)
            ),
            match hand_held_settings(view, longest_s) {
                Some(settings) => format!("put the camera on a tripod, or take {settings}"),
                None => "put the camera on a tripod".to_owned(),
            },
        ));
    }
    let limit_px = blur_limit_px(view, MIN_MOTION_LIMIT_PX);
    let motion_px = motion_px.filter(|px| *px > limit_px)?;
    let remedy = if by_hand {
        "a shorter time or a tripod"
    } else {
        "take a frame in which the recording's camera rests: its own motion blurs the frame, also on the tripod"
    };
    Some(Finding::new(
        Check::MotionBlur,
        format!(
            "the subject moved by {} px while the shutter was open (up to {} px are invisible)",
            fixed(motion_px, 1),
            fixed(limit_px, 1)
        ),
        remedy,
    ))
}

fn cut_off(subject: &Subject, object: &ObjectInView) -> Finding {
    Finding::new(
        Check::SubjectCutOff,
        format!("only {} % of {} is in the picture", percent(object.in_view), subject.name),
        format!("aim at it (`--aim \"{}\"`), or take a shorter lens", subject.name),
    )
}

fn focus(view: &ViewParticulars, subject: &Subject) -> Option<Finding> {
    let limit_px = blur_limit_px(view, MIN_CIRCLE_PX);
    if subject.defocus_px <= limit_px {
        return None;
    }
    let to = view.sharp_to_m.map_or("infinity".to_owned(), |far_m| format!("{} m", fixed(far_m, 2)));
    Some(Finding::new(
        Check::OutOfFocus,
        format!(
            "the subject at {} m is out of focus: its circle of confusion is {} px (up to {} px are invisible); at {} \
             the depth of field is {} m to {to}",
            fixed(subject.distance_m, 2),
            fixed(subject.defocus_px, 1),
            fixed(limit_px, 1),
            format_f_number(view.f_number),
            fixed(view.sharp_from_m, 2)
        ),
        format!(
            "focus on the subject (`--focus {}`), or close the aperture with a longer time",
            fixed(subject.distance_m, 2)
        ),
    ))
}

fn fixed_point(view: &ViewParticulars, object: &ObjectInView) -> Option<Finding> {
    let is_other =
        |other: &&ObjectInView| other.name != object.name && other.kind != ObjectKind::Scale && other.is_whole();
    if view.objects.iter().any(|other| is_other(&other)) {
        return None;
    }
    Some(Finding::new(
        Check::NoFixedPoint,
        format!("mid-range photograph of {} without another item, marker or prop wholly in view", object.name),
        "include a fixed point beside the item, so that the photograph shows where it lies; of real furniture the log \
         knows only what the scene has as an occluder",
    ))
}

fn tilted(subject: &Subject) -> Option<Finding> {
    if subject.angle_deg <= MAX_VIEW_ANGLE_DEG {
        return None;
    }
    Some(Finding::new(
        Check::TiltedView,
        format!(
            "the optical axis is {}° off the normal of the plane of {}: lengths along the tilt appear {} % short",
            fixed(subject.angle_deg, 0),
            subject.name,
            percent(foreshortening(subject.angle_deg))
        ),
        "hold the sensor parallel to the plane, at 90° (a level on the camera's back), for photographs that are measured",
    ))
}

fn scale_findings(view: &ViewParticulars, subject: &Subject, scale: &ScaleInView) -> Vec<Finding> {
    let mut findings = Vec::new();
    let ScaleInView { name, tilt_deg, tilt_error, height_m, height_error } = scale;
    if *tilt_deg > MAX_SCALE_TILT_DEG {
        let error = tilt_error.map_or("no measurement is possible".to_owned(), |e| format!("{} % error", percent(e)));
        findings.push(Finding::new(
            Check::ScaleOutOfPlane,
            format!("{name} lies {}° out of the plane of {}: {error}", fixed(*tilt_deg, 0), subject.name),
            "lay the scale into the plane of the feature that is measured, and support its low side",
        ));
    }
    if height_error.abs() >= MAX_HEIGHT_ERROR {
        let side = if *height_m > 0.0 { "above" } else { "below" };
        findings.push(Finding::new(
            Check::ScaleHeight,
            format!(
                "{name} lies {} mm {side} the plane of {}, at {} m: {} % error",
                fixed(1e3 * height_m.abs(), 0),
                subject.name,
                fixed(subject.distance_m, 2),
                percent(height_error.abs())
            ),
            "raise or lower the scale to the height of the feature that is measured",
        ));
    }
    let Some(object) = view.object(name) else { return findings };
    if !object.is_whole() {
        findings.push(Finding::new(
            Check::ScaleCutOff,
            format!("{name} is cut off: {} % of it is in the picture", percent(object.in_view)),
            "move the scale or step back until all of it is in the picture",
        ));
    }
    if object.longest_px() < MIN_LENGTH_PX {
        findings.push(Finding::new(
            Check::ScaleTooSmall,
            format!(
                "{name} is {} px long: read to half a pixel at both ends, lengths are uncertain by {} %",
                fixed(object.longest_px(), 0),
                percent(1.0 / object.longest_px().max(1.0))
            ),
            "fill the picture with subject and scale, or take a larger picture (`--width`)",
        ));
    }
    findings
}

/// Largest share of a side of the picture that bounds cover.
fn side_share(view: &ViewParticulars, [left, top, right, bottom]: [f64; 4]) -> f64 {
    ((right - left) / f64::from(view.width_px)).max((bottom - top) / f64::from(view.height_px))
}

fn too_small(view: &ViewParticulars, subject: &Subject, object: &ObjectInView) -> Option<Finding> {
    let scale = subject.scale.as_ref().and_then(|scale| view.object(&scale.name));
    let [left, top, right, bottom] = object.bounds_px;
    let (share, min_share, names) = match scale {
        Some(scale) => {
            let [l, t, r, b] = scale.bounds_px;
            let both = [left.min(l), top.min(t), right.max(r), bottom.max(b)];
            (side_share(view, both), MIN_WITH_SCALE_SHARE, format!("{} and {} cover", object.name, scale.name))
        }
        None => (side_share(view, object.bounds_px), MIN_SUBJECT_SHARE, format!("{} covers", object.name)),
    };
    let length = format!("{} px at {} mm per px", fixed(object.longest_px(), 0), fixed(object.mm_per_px, 2));
    if share < min_share {
        return Some(Finding::new(
            Check::SubjectTooSmall,
            format!(
                "{names} {} % of the picture's side (close-up: {} % or more), {length}",
                percent(share),
                fixed(100.0 * min_share, 0)
            ),
            "go nearer or take a longer lens: a close-up is filled by its subject",
        ));
    }
    (object.longest_px() < MIN_LENGTH_PX).then(|| {
        Finding::new(
            Check::SubjectTooSmall,
            format!("{} is {length} (close-up: {} px or more)", object.name, fixed(MIN_LENGTH_PX, 0)),
            "take a larger picture (`--width`), or go nearer",
        )
    })
}
