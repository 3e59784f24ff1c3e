//! Resolves the aim of a photograph to pixels of the recorded picture.

use glam::{DVec2, DVec3};

use super::error::{PhotoError, refused};
use super::framing::Aim;
use super::request::PhotoRequest;
use crate::camera::Geometry;
use crate::recording::Recording;
use crate::scene::{Object, Scene};

/// Share of the photograph filled by an object, in width or in height.
const OBJECT_SHARE: f64 = 0.5;

fn place(text: &str) -> Option<DVec2> {
    let (x, y) = text.split_once(',')?;
    let number = |text: &str| text.trim().parse().ok().filter(|v: &f64| v.is_finite());
    Some(DVec2::new(number(x)?, number(y)?))
}

/// Name of the photograph's subject as the photographer gave it: the subject, or the object that is
/// aimed at. `None` without either.
pub fn subject_name(request: &PhotoRequest, scene: &Scene) -> Result<Option<String>, PhotoError> {
    let name = |option: &str, text: &str| named(option, text, scene).map(|object| Some(object.name.clone()));
    match (&request.subject, &request.aim) {
        (Some(subject), _) => name("--subject", subject),
        (None, Some(aim)) if place(aim).is_none() => name("--aim", aim),
        _ => Ok(None),
    }
}

pub fn aim(
    request: &PhotoRequest,
    recording: &Recording,
    recorded_geometry: &Geometry,
    scene: &Scene,
) -> Result<Aim, PhotoError> {
    let PhotoRequest { frame, focal_length_mm, across_px, .. } = request;
    let across = across_px.map(|columns| DVec2::new(columns, 0.0));
    let Some(aim_text) = &request.aim else { return Ok(Aim { at_px: None, around_px: across }) };
    let size = DVec2::new(recorded_geometry.intrinsics.width_px.into(), recorded_geometry.intrinsics.height_px.into());
    if let Some(at) = place(aim_text) {
        if at.cmplt(DVec2::ZERO).any() || at.cmpgt(size).any() {
            return refused(format!("--aim {aim_text} lies outside the picture, {}x{} px", size.x, size.y));
        }
        return Ok(Aim { at_px: Some(at), around_px: across });
    }
    let object = named("--aim", aim_text, scene)?;
    let pose = recording.pose_at_frame(*frame)?;
    let projected = points(object, scene).filter_map(|point| recorded_geometry.project(pose.transform_point(point)));
    let bounds = projected.map(|at| (at, at)).reduce(|(low, high), (at, _)| (low.min(at), high.max(at)));
    let in_picture = bounds.map(|(low, high)| (low.max(DVec2::ZERO), high.min(size)));
    let Some((low, high)) = in_picture.filter(|(low, high)| low.cmplt(*high).all()) else {
        return refused(format!("--aim {aim_text}: it is not in the picture of frame {frame}"));
    };
    let around = across.or(focal_length_mm.is_none().then(|| {
        let around = (high - low) / OBJECT_SHARE;
        // Limited to the picture, whatever the film's shape.
        around * (size / around).min_element().min(1.0)
    }));
    Ok(Aim { at_px: Some(0.5 * (low + high)), around_px: around })
}

/// The object with this name, or the only one whose name contains it.
fn named<'a>(option: &str, name: &str, scene: &'a Scene) -> Result<&'a Object, PhotoError> {
    let mut like = scene.objects.iter().filter(|object| object.name.to_lowercase().contains(&name.to_lowercase()));
    let exact = scene.objects.iter().find(|object| object.name == name);
    let only = like.next().filter(|_| like.next().is_none());
    exact.or(only).ok_or_else(|| {
        let names: Vec<_> = scene.objects.iter().map(|object| object.name.as_str()).collect();
        let names = names.join(", ");
        let expected = if option == "--aim" { "neither X,Y nor the name" } else { "not the name" };
        PhotoError::Refused(format!("{option} {name}: {expected} of one object; there are: {names}"))
    })
}

/// Its vertices in the world.
fn points<'a>(object: &'a Object, scene: &'a Scene) -> impl Iterator<Item = DVec3> + 'a {
    object.parts.iter().flat_map(|part| {
        let vertices = scene.meshes[part.mesh].vertices.iter();
        vertices.map(|v| part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from))))
    })
}
