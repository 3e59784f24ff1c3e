//! Reads a scan of a place: a file of a scanner, or a model.

use std::path::Path;

use glam::DVec3;

use super::{Scene, SceneError, is_model, load};
use crate::site::SiteScan;
use crate::site::scan_file::{ReadingWatch, ScanGeometry};

/// Reads a scan from a file of [`scan_file`](crate::site::scan_file), or the meshes of a `.glb` or
/// `.gltf` file. `metres_per_unit` overrides the unit of the format; without both it is the metre.
pub fn read_scan(path: &Path, metres_per_unit: Option<f64>) -> Result<SiteScan, SceneError> {
    read_scan_watched(path, metres_per_unit, &ReadingWatch::default())
}

/// Like [`read_scan`]; another thread watches the progress and may end it, except for models.
pub fn read_scan_watched(
    path: &Path,
    metres_per_unit: Option<f64>,
    watch: &ReadingWatch,
) -> Result<SiteScan, SceneError> {
    if !is_model(path) {
        return SiteScan::read_watched(path, metres_per_unit, watch).map_err(SceneError::Scan);
    }
    let geometry = geometry(&load(path, None)?);
    if geometry.triangles.is_empty() {
        return Err(SceneError::bad(path, "meshes", "no triangles", "the mesh of a place"));
    }
    Ok(SiteScan::of_geometry(path, geometry, metres_per_unit))
}

fn geometry(scene: &Scene) -> ScanGeometry {
    let (mut positions, mut triangles, mut origin) = (Vec::new(), Vec::new(), None);
    for part in scene.objects.iter().flat_map(|object| &object.parts) {
        let mesh = &scene.meshes[part.mesh];
        let first = positions.len() as u32;
        positions.extend(mesh.vertices.iter().map(|vertex| {
            let at = part.world_from_mesh.transform_point3(DVec3::from(vertex.position.map(f64::from)));
            (at - *origin.get_or_insert(at.round())).as_vec3()
        }));
        triangles.extend(mesh.indices.chunks_exact(3).map(|corners| [0, 1, 2].map(|n| first + corners[n])));
    }
    ScanGeometry {
        origin: origin.unwrap_or_default(),
        positions,
        triangles,
        metres_per_unit: Some(1.0),
        up: Some(DVec3::Y),
        warnings: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn model_is_a_scan_of_its_triangles_in_metres() {
        let scan = read_scan(Path::new("scenes/marker-1.glb"), None).unwrap();
        assert!(scan.triangle_count > 10 && scan.up == Some(DVec3::Y));
        let [low, high] = scan.bounds_m;
        // A tent of about 10 cm that stands on the origin.
        assert!(low.y.abs() < 1e-3 && (0.05..0.3).contains(&high.y), "{low} to {high}");
    }
}
