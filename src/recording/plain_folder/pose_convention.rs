//! The convention of a folder's poses: its direction and the camera's axes. It is stated in a
//! comment, or camera to world with OpenCV's axes. Depth decides: the depth of a frame, moved into
//! another frame, must agree with the depth there.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::matrices::PoseMatrix;
use crate::camera::Geometry;
use crate::pixels::DepthMap;
use crate::pose::Pose;

/// A convention of pose matrices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseConvention {
    pub is_world_to_camera: bool,
    /// y up, the camera's axis is −z.
    pub has_opengl_axes: bool,
}

/// Words of a comment, in lower case with underscores between words.
const TO_WORLD: [&str; 3] = ["camera_to_world", "world_from_camera", "c2w"];
const TO_CAMERA: [&str; 3] = ["world_to_camera", "camera_from_world", "w2c"];
const OPENGL: [&str; 2] = ["opengl", "blender"];
const OPENCV: [&str; 1] = ["opencv"];

impl PoseConvention {
    const ALL: [Self; 4] = [
        Self { is_world_to_camera: false, has_opengl_axes: false },
        Self { is_world_to_camera: true, has_opengl_axes: false },
        Self { is_world_to_camera: false, has_opengl_axes: true },
        Self { is_world_to_camera: true, has_opengl_axes: true },
    ];

    /// The convention named in the comments before the first pose.
    pub fn stated(text: &str) -> Result<Option<Self>, String> {
        let lines = text.trim_start_matches('\u{feff}').lines().map(str::trim);
        let comments = lines.take_while(|line| line.is_empty() || line.starts_with('#'));
        let words: String = comments.flat_map(|line| line.chars().chain([' '])).collect();
        let joined: String = words.to_lowercase().chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
        let has = |names: &[&str]| names.iter().any(|name| joined.contains(name));
        let [to_world, to_camera, opengl, opencv] = [has(&TO_WORLD), has(&TO_CAMERA), has(&OPENGL), has(&OPENCV)];
        if (to_world && to_camera) || (opengl && opencv) {
            return Err("its first comment names two conventions; expected one, as in `# world_to_camera`".to_owned());
        }
        let is_stated = to_world || to_camera || opengl || opencv;
        Ok(is_stated.then_some(Self { is_world_to_camera: to_camera, has_opengl_axes: opengl }))
    }

    /// The pose of a matrix, with OpenCV's axes and the matrix's unit.
    pub fn camera_from_world(self, (rotation, translation): &PoseMatrix) -> Pose {
        // From OpenGL's axes to OpenCV's, and back: y and z are reversed.
        let axes = if self.has_opengl_axes { DVec3::new(1.0, -1.0, -1.0) } else { DVec3::ONE };
        let axes = DMat3::from_diagonal(axes);
        if self.is_world_to_camera {
            let turn = DQuat::from_mat3(&(axes * *rotation)).normalize();
            return Pose::new(turn, axes * *translation);
        }
        let turn = DQuat::from_mat3(&(*rotation * axes)).normalize();
        Pose::from_camera_in_world(*translation, turn)
    }

    fn name(self) -> String {
        let direction = if self.is_world_to_camera { "world to camera" } else { "camera to world" };
        let axes = if self.has_opengl_axes { "OpenGL" } else { "OpenCV" };
        format!("{direction} with {axes}'s axes")
    }

    /// The comment that states it.
    fn comment(self) -> String {
        let direction = if self.is_world_to_camera { TO_CAMERA[0] } else { TO_WORLD[0] };
        let axes = if self.has_opengl_axes { OPENGL[0] } else { OPENCV[0] };
        format!("# {direction} {axes}")
    }
}

/// Depth of a frame with its pose matrix and the camera that took it.
#[derive(Debug)]
pub struct PosedDepth {
    pub matrix: PoseMatrix,
    pub camera: Geometry,
    pub map: DepthMap,
}

/// Samples of a depth map along each side.
const SAMPLES_PER_SIDE: u32 = 24;
/// Fewest samples for a decision.
const MIN_SAMPLES: usize = 300;
/// Largest relative difference of depths that agree, and the absolute one, m: a depth camera's
/// noise and errors of poses.
const DEPTH_TOLERANCE: f64 = 0.02;
const DEPTH_TOLERANCE_M: f64 = 0.005;
/// The convention with the highest agreement is certain from this share on, this much above all
/// others.
const CLEAR_AGREEMENT: f64 = 0.3;
const CLEAR_MARGIN: f64 = 0.15;

/// ConventionShares of depth under each of [`PoseConvention::ALL`], as shares of the samples.
#[derive(Clone, Copy, Debug, Default)]
struct ConventionShares {
    shares: [f64; 4],
    count: usize,
}

impl ConventionShares {
    /// Statistics of views that are `gap` apart.
    fn of(views: &[PosedDepth], gap: usize, metres_per_unit: f64) -> Self {
        let each = PoseConvention::ALL.map(|convention| agreement(convention, views, gap, metres_per_unit));
        Self { shares: each.map(|(share, _)| share), count: each[0].1 }
    }

    /// The best convention and its lead over the second.
    fn best(&self) -> (usize, f64) {
        let mut order = [0, 1, 2, 3];
        order.sort_by(|a: &usize, b: &usize| self.shares[*b].total_cmp(&self.shares[*a]));
        (order[0], self.shares[order[0]] - self.shares[order[1]])
    }

    /// The convention that the depth shows, if it is certain.
    fn certain(&self) -> Option<usize> {
        let (best, lead) = self.best();
        let is_clear = self.count >= MIN_SAMPLES && self.shares[best] >= CLEAR_AGREEMENT && lead >= CLEAR_MARGIN;
        is_clear.then_some(best)
    }

    fn percent(&self, index: usize) -> String {
        format!("{:.0} %", 100.0 * self.shares[index])
    }
}

/// The share of samples of each view that agree with the depth of the view `gap` further, and
/// their number.
fn agreement(convention: PoseConvention, views: &[PosedDepth], gap: usize, metres_per_unit: f64) -> (f64, usize) {
    let (mut agreed, mut count) = (0, 0);
    let pose = |view: &PosedDepth| {
        let Pose { rotation, translation_m } = convention.camera_from_world(&view.matrix);
        Pose::new(rotation, translation_m * metres_per_unit)
    };
    for (from, to) in views.iter().zip(views.iter().skip(gap)) {
        let (from_pose, to_pose) = (pose(from), pose(to));
        for (column, row) in
            (0..SAMPLES_PER_SIDE).flat_map(|row| (0..SAMPLES_PER_SIDE).map(move |column| (column, row)))
        {
            let at = |sample: u32, side: u32| (2 * sample + 1) * side / (2 * SAMPLES_PER_SIDE);
            let (x, y) = (at(column, from.map.width), at(row, from.map.height));
            let Some(depth_m) = depth_at(&from.map, x, y) else { continue };
            let Some(ray) = from.camera.depth_ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)) else { continue };
            count += 1;
            let moved = to_pose.transform_point(from_pose.inverse_transform_point(ray * depth_m));
            let Some(landed) = to.camera.project(moved) else { continue };
            let is_inside = landed.cmpge(DVec2::ZERO).all();
            let there = is_inside.then(|| depth_at(&to.map, landed.x as u32, landed.y as u32)).flatten();
            let tolerance_m = DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * moved.z;
            agreed += usize::from(there.is_some_and(|there| (there - moved.z).abs() <= tolerance_m));
        }
    }
    (if count > 0 { agreed as f64 / count as f64 } else { 0.0 }, count)
}

/// Depth of a pixel; `None` outside the map and where it is unknown.
fn depth_at(map: &DepthMap, x: u32, y: u32) -> Option<f64> {
    let is_inside = x < map.width && y < map.height;
    let depth_m = is_inside.then(|| map.depth_m.get((y * map.width + x) as usize)).flatten()?;
    (*depth_m > 0.0 && depth_m.is_finite()).then(|| f64::from(*depth_m))
}

/// The convention to use, and a warning if nothing confirms it. An error if depth shows another
/// one than the one that is assumed.
pub fn check(
    stated: Option<PoseConvention>,
    views: &[PosedDepth],
    metres_per_unit: f64,
) -> Result<(PoseConvention, Option<String>), String> {
    let convention = stated.unwrap_or_default();
    let own = PoseConvention::ALL.iter().position(|other| *other == convention).unwrap_or_default();
    // Near views of a slow camera agree under every convention, distant ones may not overlap.
    let gaps = [1, (views.len() / 2).max(1)].map(|gap| ConventionShares::of(views, gap, metres_per_unit));
    let certain = |agreement: &ConventionShares| agreement.certain().map(|best| (*agreement, best));
    let decided = gaps.iter().filter_map(certain).max_by(|(a, _), (b, _)| a.best().1.total_cmp(&b.best().1));
    let Some((agreement, best)) = decided else {
        if stated.is_some() {
            return Ok((convention, None));
        }
        let warning = format!(
            "its poses are taken as {}; no depth confirms it. A first line such as `{}` states another convention",
            convention.name(),
            PoseConvention { is_world_to_camera: true, ..convention }.comment()
        );
        return Ok((convention, Some(warning)));
    };
    if best == own {
        return Ok((convention, None));
    }
    let other = PoseConvention::ALL[best];
    let shares = format!(
        "as {} its poses move {} of the depth samples onto the depth of other frames, as {} {}",
        convention.name(),
        agreement.percent(own),
        other.name(),
        agreement.percent(best)
    );
    if stated.is_some() {
        return Ok((convention, Some(format!("{shares}; the convention in its comment is kept"))));
    }
    Err(format!("{shares}; write the right convention into the first line, as in `{}`", other.comment()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Views into a corner of three planes, x = 2, y = 1.5 and z = 5, with poses in a convention.
    fn views(convention: PoseConvention) -> Vec<PosedDepth> {
        let camera = Geometry::pinhole(64, 48, 60.0);
        let view = |i: i32| {
            let step = f64::from(i);
            let turn = DQuat::from_rotation_y(0.1 * step)
                * DQuat::from_rotation_z(0.3 + 0.12 * step)
                * DQuat::from_rotation_x(-0.15 + 0.08 * step);
            let pose = Pose::from_camera_in_world(DVec3::new(0.15 * f64::from(i) - 0.4, 0.2, 0.3), turn);
            let centre = pose.position_in_world_m();
            let depth = |x: u32, y: u32| {
                let ray = camera.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
                let along = pose.inverse_transform_point(ray) - centre;
                let planes = [(2.0 - centre.x) / along.x, (1.5 - centre.y) / along.y, (5.0 - centre.z) / along.z];
                planes.into_iter().filter(|depth| *depth > 0.0).fold(f64::INFINITY, f64::min) as f32
            };
            let depth_m = (0..48).flat_map(|y| (0..64).map(move |x| (x, y))).map(|(x, y)| depth(x, y)).collect();
            let map = DepthMap { width: 64, height: 48, depth_m, timestamp_s: 0.0 };
            let axes = if convention.has_opengl_axes { DVec3::new(1.0, -1.0, -1.0) } else { DVec3::ONE };
            let axes = DMat3::from_diagonal(axes);
            let matrix = if convention.is_world_to_camera {
                (axes * DMat3::from_quat(pose.rotation), axes * pose.translation_m)
            } else {
                (DMat3::from_quat(turn) * axes, centre)
            };
            PosedDepth { matrix, camera: camera.clone(), map }
        };
        (0..5).map(view).collect()
    }

    #[test]
    fn depth_distinguishes_all_four_conventions() {
        for truth in PoseConvention::ALL {
            let views = views(truth);
            assert_eq!(ConventionShares::of(&views, 1, 1.0).count, 4 * 576);
            let checked = check(None, &views, 1.0);
            if truth == PoseConvention::default() {
                assert_eq!(checked, Ok((truth, None)));
            } else {
                let error = checked.unwrap_err();
                assert!(error.contains(&truth.name()) && error.contains(&truth.comment()), "{error}");
            }
            assert_eq!(check(Some(truth), &views, 1.0), Ok((truth, None)));
            let pose = truth.camera_from_world(&views[2].matrix);
            assert!((pose.position_in_world_m() - DVec3::new(-0.1, 0.2, 0.3)).length() < 1e-12);
        }
        let (kept, warning) = check(Some(PoseConvention::ALL[1]), &views(PoseConvention::ALL[0]), 1.0).unwrap();
        assert!(kept.is_world_to_camera && warning.unwrap().contains("the convention in its comment is kept"));
    }

    #[test]
    fn convention_is_assumed_without_depth() {
        let (convention, warning) = check(None, &[], 1.0).unwrap();
        assert!(convention == PoseConvention::default() && warning.unwrap().contains("`# world_to_camera opencv`"));
        assert_eq!(check(Some(convention), &[], 1.0).unwrap().1, None);
    }

    #[test]
    fn comments_state_the_convention() {
        let stated = |text: &str| PoseConvention::stated(text).unwrap();
        for text in ["# world to camera\n1 0", "\n# c\n# World-to-Camera, OpenCV\n", "# W2C\n"] {
            assert_eq!(
                stated(text),
                Some(PoseConvention { is_world_to_camera: true, has_opengl_axes: false }),
                "{text}"
            );
        }
        assert_eq!(
            stated("# c2w (Blender)\n"),
            Some(PoseConvention { is_world_to_camera: false, has_opengl_axes: true })
        );
        assert_eq!((stated("# poses\n"), stated("1 0 0\n# w2c\n")), (None, None));
        assert!(PoseConvention::stated("# w2c, inverse of c2w\n").unwrap_err().contains("two conventions"));
    }
}
