//! The world of a solved recording: its scale, its up and its floor. Pictures alone determine none
//! of them.
//!
//! In order of preference: a board of tags that the pictures show gives all three. A measured
//! distance between two points gives the scale. Otherwise the scale is assumed, by the height at
//! which people hold a camera. Without a board, up is the normal of the largest level surface among
//! the landmarks, or the cameras' own mean up.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::error::SolveError;
use super::patch::{LumaPyramid, track_patch};
use super::resection::{PosedFrame, predict_on};
use super::triangulation::triangulate;
use crate::camera::Geometry;
use crate::fit::SimilarityTransform;
use crate::fit::quantile::upper_median;
use crate::pixels::Pixels;
use crate::plane::{HessePlane, Plane};
use crate::pose::{Pose, camera_up};
use crate::support::{MeasuredPoint, plane_through, ransac_plane};
use crate::tags::{Board, Detector, LumaCodes, refine_corners};

/// Largest number of pictures that are searched for tags or for measured points.
const MAX_SEARCHED: usize = 60;
/// Smallest number of tags of a board that was not named: other sheets share its family and ids.
const MIN_UNNAMED_TAGS: usize = 2;
/// Largest root mean square distance of the corners from the board, as a share of its extent: it
/// does not describe the tags otherwise.
const MAX_BOARD_ERROR: f64 = 0.02;
/// Assumed height of the cameras above a level surface, and assumed median distance of the
/// landmarks where there is none, m.
const ASSUMED_HEIGHT_M: f64 = 1.5;
const ASSUMED_DISTANCE_M: f64 = 2.5;
/// Tolerance of a landmark on a level surface, as a share of its distance from the nearest camera.
const TOLERANCE_SHARE: f64 = 0.01;
/// Cosine of the largest angle between a level surface's normal and the cameras' own up.
const LEVEL_COSINE: f64 = 0.64;
/// Smallest share of the landmarks on a level surface.
const MIN_LEVEL_SHARE: f64 = 0.05;
/// Number of nearest landmarks that give the surface at a picked point, and the smallest cosine
/// between its normal and the view.
const NEAREST: usize = 9;
const MIN_FACING: f64 = 0.15;

/// How the scale is known.
#[derive(Clone, Debug, PartialEq)]
pub enum ScaleSource {
    /// Tags of a board: their number, and the rms distance of their corners from it, m.
    Board { tags: usize, rms_m: f64 },
    /// A measured distance between two points.
    Distance { length_m: f64, views: usize },
    /// An assumed height above the level surface (`Some`) or distance of the landmarks, m.
    Assumed { height_m: Option<f64>, distance_m: f64 },
}

/// How up is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UpSource {
    Board,
    /// The normal of a level surface, with its share of the landmarks. It is the floor, z = 0.
    Surface {
        share: f64,
    },
    /// The mean of the cameras' own.
    Cameras,
}

/// The world of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldGauge {
    pub world_from_model: SimilarityTransform,
    pub scale: ScaleSource,
    pub up: UpSource,
}

/// A measured distance between two points of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDistance {
    pub frame: usize,
    pub points_px: [DVec2; 2],
    pub length_m: f64,
}

/// A solved model: one camera, frames with poses, and landmarks.
#[derive(Debug)]
pub struct GaugeInputs<'a> {
    pub geometry: &'a Geometry,
    /// Ascending.
    pub frames: &'a [PosedFrame],
    /// A board that the user named, or the usual one.
    pub board: &'a Board,
    pub is_board_named: bool,
    pub light: &'a [f32],
}

/// Reads the picture of a frame.
pub type ReadFrame<'a> = &'a dyn Fn(usize) -> Result<Pixels, SolveError>;

/// The world of a model.
pub fn gauge(
    inputs: &GaugeInputs<'_>,
    distance: Option<&MeasuredDistance>,
    read: ReadFrame<'_>,
) -> Result<WorldGauge, SolveError> {
    if distance.is_none()
        && let Some(board_gauge) = by_board(inputs, read)?
    {
        return Ok(board_gauge);
    }
    let cameras: Vec<DVec3> = inputs.frames.iter().map(|frame| frame.pose.position_in_world_m()).collect();
    let guess = camera_up(inputs.frames.iter().map(|frame| frame.pose.world_from_camera_rotation()));
    let depths = inputs
        .frames
        .iter()
        .flat_map(|frame| frame.landmarks.iter().map(|(point, _)| point.distance(frame.pose.position_in_world_m())));
    let median = upper_median(depths).filter(|median| *median > 0.0).unwrap_or(1.0);
    let surface = level_surface(inputs, guess);
    let above = |plane: &HessePlane| upper_median(cameras.iter().map(|camera| plane.height_m(*camera)));
    let height = surface.as_ref().and_then(|(plane, _)| above(plane)).filter(|height| *height > 0.1 * median);
    let (scale, source) = match distance {
        Some(distance) => by_distance(inputs, distance, read)?,
        None => {
            let scale = height.map_or(ASSUMED_DISTANCE_M / median, |height| ASSUMED_HEIGHT_M / height);
            let height_m = height.map(|_| ASSUMED_HEIGHT_M);
            (scale, ScaleSource::Assumed { height_m, distance_m: scale * median })
        }
    };
    let up = surface.as_ref().map_or(guess, |(plane, _)| plane.normal);
    let first = inputs.frames.first().map_or(Pose::IDENTITY, |frame| frame.pose);
    let rotation = upright(up, first.world_from_camera_rotation() * DVec3::Z);
    // The origin is below the first camera: on the surface, else at the camera.
    let camera = first.position_in_world_m();
    let origin = surface.as_ref().map_or(camera, |(plane, _)| camera - plane.height_m(camera) * plane.normal);
    Ok(WorldGauge {
        world_from_model: SimilarityTransform { scale, rotation, translation_m: -scale * (rotation * origin) },
        scale: source,
        up: surface.map_or(UpSource::Cameras, |(_, share)| UpSource::Surface { share }),
    })
}

/// The rotation that takes `up` to z, and `forward`, as far as it is level, to y.
fn upright(up: DVec3, forward: DVec3) -> DQuat {
    let level = |direction: DVec3| (direction - direction.dot(up) * up).try_normalize();
    let y = level(forward).or_else(|| level(DVec3::X)).or_else(|| level(DVec3::Y)).unwrap_or(DVec3::Y);
    DQuat::from_mat3(&DMat3::from_cols(y.cross(up), y, up)).conjugate()
}

/// The level surface with most landmarks, in the model's unit, and its share of them.
fn level_surface(inputs: &GaugeInputs<'_>, guess: DVec3) -> Option<(HessePlane, f64)> {
    // Each landmark by the camera nearest to it.
    let mut nearest: BTreeMap<[u64; 3], MeasuredPoint> = BTreeMap::new();
    for frame in inputs.frames {
        let camera_m = frame.pose.position_in_world_m();
        for (point, _) in &frame.landmarks {
            let tolerance_m = TOLERANCE_SHARE * point.distance(camera_m);
            let point = nearest.entry(point.to_array().map(f64::to_bits)).or_insert(MeasuredPoint {
                at_m: *point,
                tolerance_m,
                camera_m,
            });
            if tolerance_m < point.tolerance_m {
                (point.tolerance_m, point.camera_m) = (tolerance_m, camera_m);
            }
        }
    }
    let points: Vec<MeasuredPoint> = nearest.into_values().collect();
    let plane = ransac_plane(&points, |normal| normal.dot(guess).abs() > LEVEL_COSINE)?.facing(guess);
    let on = points.iter().filter(|point| point.is_inlier(&plane)).count() as f64;
    // Cameras look down on floors and tables; a ceiling is no ground.
    let is_below = inputs.frames.iter().all(|frame| plane.height_m(frame.pose.position_in_world_m()) > 0.0);
    let share = on / points.len().max(1) as f64;
    (is_below && share >= MIN_LEVEL_SHARE).then_some((plane, share))
}

/// The world of a board of tags. `None` if too few of its tags are seen.
fn by_board(inputs: &GaugeInputs<'_>, read: ReadFrame<'_>) -> Result<Option<WorldGauge>, SolveError> {
    let GaugeInputs { geometry, frames, board, is_board_named, light, .. } = *inputs;
    let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
    let mut detector = Detector::new(board.family, width, height)?;
    // Views of each corner: tag and corner.
    let mut views: BTreeMap<(u32, usize), Vec<(Pose, DVec2)>> = BTreeMap::new();
    for frame in frames.iter().step_by(frames.len().div_ceil(MAX_SEARCHED).max(1)) {
        let grey = LumaCodes::of(&read(frame.frame)?, light.to_vec());
        for tag in detector.find_board(&grey, board)?.tags {
            let tag = refine_corners(&grey, geometry, board.family.cells(), &tag);
            for (corner, at_px) in tag.corners_px.into_iter().enumerate() {
                views.entry((tag.id, corner)).or_default().push((frame.pose, at_px));
            }
        }
    }
    let mut pairs = Vec::new();
    let mut tags: Vec<u32> = Vec::new();
    for ((id, corner), views) in &views {
        if let (Some(tag), Some(point)) = (board.tag(*id), triangulate(geometry, views)) {
            pairs.push((point, tag.corners_m()[*corner]));
            tags.push(*id);
        }
    }
    tags.dedup();
    let min_tags = if is_board_named { 1 } else { MIN_UNNAMED_TAGS };
    let Some(similarity) = SimilarityTransform::between(&pairs).filter(|_| tags.len() >= min_tags) else {
        return Ok(None);
    };
    let squares: f64 = pairs.iter().map(|(from, to)| similarity.transform_point(*from).distance_squared(*to)).sum();
    let rms_m = (squares / pairs.len() as f64).sqrt();
    let extent_m = pairs.iter().map(|(_, to)| to.distance(pairs[0].1)).fold(0.0, f64::max);
    if rms_m > MAX_BOARD_ERROR * extent_m {
        // Other tags of the same family and ids.
        if is_board_named {
            return Err(SolveError::Board { rms_m, extent_m });
        }
        return Ok(None);
    }
    let scale = ScaleSource::Board { tags: tags.len(), rms_m };
    Ok(Some(WorldGauge { world_from_model: similarity, scale, up: UpSource::Board }))
}

/// The surface at a pixel of a frame: the plane through the nearest landmarks, or one that faces
/// the camera at their median depth if they are not on one.
fn surface_at(landmarks: &[(DVec3, DVec2)], pose: &Pose, at_px: DVec2) -> Option<HessePlane> {
    let mut near: Vec<(f64, DVec3)> =
        landmarks.iter().map(|(point, landmark_px)| (landmark_px.distance(at_px), *point)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let near: Vec<DVec3> = near.into_iter().take(NEAREST).map(|(_, point)| point).collect();
    let depth = upper_median(near.iter().map(|point| pose.transform_point(*point).z))?;
    let normal = pose.world_from_camera_rotation() * DVec3::Z;
    let facing = Plane { point_m: pose.inverse_transform_point(DVec3::new(0.0, 0.0, depth)), normal }.into();
    let fitted = plane_through(&near).ok().filter(|fit| fit.rms_m < TOLERANCE_SHARE * depth);
    // A plane that is seen along itself is a bad guess.
    let fitted = fitted.map(|fit| fit.plane).filter(|plane| plane.normal.dot(normal).abs() > MIN_FACING);
    Some(fitted.unwrap_or(facing))
}

/// Metres per unit, by a measured distance.
fn by_distance(
    inputs: &GaugeInputs<'_>,
    distance: &MeasuredDistance,
    read: ReadFrame<'_>,
) -> Result<(f64, ScaleSource), SolveError> {
    let MeasuredDistance { frame, points_px, length_m } = *distance;
    let at = inputs.frames.iter().find(|posed| posed.frame == frame).ok_or_else(|| {
        let nearest = inputs.frames.iter().min_by_key(|posed| posed.frame.abs_diff(frame)).map(|posed| posed.frame);
        SolveError::DistanceFrame { frame, nearest: nearest.unwrap_or_default() }
    })?;
    let others: Vec<&PosedFrame> = inputs.frames.iter().filter(|posed| posed.frame != frame).collect();
    let picture = LumaPyramid::of(&read(frame)?, 3);
    let mut points = [DVec3::ZERO; 2];
    let mut min_views = usize::MAX;
    let step = others.len().div_ceil(MAX_SEARCHED).max(1);
    let searched: Vec<(&PosedFrame, LumaPyramid)> = others
        .into_iter()
        .step_by(step)
        .map(|other| Ok((other, LumaPyramid::of(&read(other.frame)?, 3))))
        .collect::<Result<_, SolveError>>()?;
    for (points, at_px) in points.iter_mut().zip(points_px) {
        let failure = SolveError::DistancePoint { frame, at_px };
        let surface = surface_at(&at.landmarks, &at.pose, at_px);
        let camera = at.pose.position_in_world_m();
        let ray = inputs.geometry.unproject(at_px).map(|ray| at.pose.world_from_camera_rotation() * ray);
        let guess = surface.zip(ray).map(|(surface, ray)| {
            let along = -surface.height_m(camera) / surface.normal.dot(ray);
            (surface, camera + along * ray)
        });
        let Some((surface, guess)) = guess.filter(|(_, guess)| guess.is_finite()) else { return Err(failure) };
        let mut views = vec![(at.pose, at_px)];
        for (other, pyramid) in &searched {
            let predicted = predict_on(inputs.geometry, &at.pose, &other.pose, &surface, guess, at_px);
            if let Some(matched_px) = predicted.and_then(|predicted| track_patch(&picture, pyramid, &predicted)) {
                views.push((other.pose, matched_px));
            }
        }
        *points = triangulate(inputs.geometry, &views).ok_or(failure)?;
        min_views = min_views.min(views.len());
    }
    let units = points[0].distance(points[1]);
    let scale = length_m / units;
    if !(scale.is_finite() && units > 0.0) {
        return Err(SolveError::DistancePoint { frame, at_px: points_px[1] });
    }
    Ok((scale, ScaleSource::Distance { length_m, views: min_views }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upright_takes_up_to_z_and_the_view_to_y() {
        let up = DVec3::new(0.1, -0.9, 0.2).normalize();
        let rotation = upright(up, DVec3::new(0.3, 0.2, 0.9));
        assert!((rotation * up - DVec3::Z).length() < 1e-12);
        let ahead = rotation * DVec3::new(0.3, 0.2, 0.9);
        assert!(ahead.x.abs() < 1e-12 && ahead.y > 0.0, "{ahead}");
        // A vertical optical axis has a world, too.
        assert!((upright(DVec3::Z, DVec3::NEG_Z) * DVec3::Z - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn floor_below_the_cameras_gives_up_and_the_assumed_height() {
        // Up is −y, the floor at y = 0.6 units, the cameras at y = 0; the walls are at z = 4.
        let floor = (0..400).map(|i| DVec3::new(-1.0 + 0.1 * f64::from(i % 20), 0.6, 1.0 + 0.1 * f64::from(i / 20)));
        let wall = (0..200).map(|i| DVec3::new(-1.0 + 0.1 * f64::from(i % 20), 0.5 - 0.1 * f64::from(i / 20), 4.0));
        let landmarks: Vec<(DVec3, DVec2)> = floor.chain(wall).map(|point| (point, DVec2::ZERO)).collect();
        let frame = |n: usize| PosedFrame {
            frame: n,
            pose: Pose::from_camera_in_world(DVec3::new(0.1 * n as f64, 0.0, 0.0), DQuat::from_rotation_x(0.2)),
            landmarks: landmarks.clone(),
        };
        let frames = [frame(0), frame(1)];
        let board = crate::tags::Sheet::new(crate::tags::Paper::A4).board;
        let inputs = GaugeInputs {
            geometry: &Geometry::pinhole(64, 48, 50.0),
            frames: &frames,
            board: &board,
            is_board_named: false,
            light: &[0.0; 256],
        };
        let dark = |_: usize| Ok(Pixels::from_u8(64, 48, vec![0; 3 * 64 * 48]).unwrap());
        let gauge = gauge(&inputs, None, &dark).unwrap();
        assert!(matches!(gauge.up, UpSource::Surface { share } if share > 0.6), "{gauge:?}");
        assert_eq!(
            gauge.scale,
            ScaleSource::Assumed {
                height_m: Some(1.5),
                distance_m: match gauge.scale {
                    ScaleSource::Assumed { distance_m, .. } => distance_m,
                    _ => 0.0,
                }
            }
        );
        let at = |point: DVec3| gauge.world_from_model.transform_point(point);
        assert!((at(DVec3::new(0.0, 0.0, 0.0)) - DVec3::new(0.0, 0.0, 1.5)).length() < 1e-6);
        assert!(at(DVec3::new(0.5, 0.6, 2.0)).z.abs() < 1e-6);
        assert!((gauge.world_from_model.scale - 2.5).abs() < 1e-6);
    }
}
