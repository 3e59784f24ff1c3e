//! The table `[site]` of a scene file: a scan of the place, and where it is.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::SceneError;
use crate::pose::Pose;
use crate::text::number;

/// A scan of the place, in the scene's world.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SiteTable {
    /// A file of [`site::scan_file`](crate::site::scan_file), relative to the scene file.
    pub scan: String,
    /// Length of the scan's unit; default that of its format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metres_per_unit: Option<f64>,
    /// The scan's origin in the world, m; default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
    /// World from scan: x, y, z, w; default no rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
}

impl SiteTable {
    /// `None` if the numbers are no valid pose.
    pub fn world_from_scan(&self) -> Option<Pose> {
        let position = DVec3::from(self.position_m.unwrap_or_default());
        let rotation = self.quaternion.map_or(DQuat::IDENTITY, DQuat::from_array);
        let is_valid = position.is_finite() && (rotation.length() - 1.0).abs() < 1e-3;
        is_valid.then(|| Pose::new(rotation, position))
    }
}

/// A scan of the place, before it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SitePlacement {
    pub scan: PathBuf,
    /// Length of the scan's unit, m; `None`: that of its format.
    pub metres_per_unit: Option<f64>,
    /// Takes a point of the scan, m, to the scene's world.
    pub world_from_scan: Pose,
}

/// The place of a scan. Its file is read when a shot needs it.
pub(super) fn read_site(file: &Path, site: &SiteTable) -> Result<SitePlacement, SceneError> {
    if let Some(metres_per_unit) = site.metres_per_unit.filter(|m| !(*m > 0.0 && m.is_finite())) {
        return Err(SceneError::bad(file, "site.metres_per_unit", metres_per_unit, "more than 0"));
    }
    let world_from_scan = site.world_from_scan().ok_or_else(|| {
        let numbers = |values: &[f64]| values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(", ");
        let position = site.position_m.map(|position| format!("position_m [{}]", numbers(&position)));
        let quaternion = site.quaternion.map(|quaternion| format!("quaternion [{}]", numbers(&quaternion)));
        let actual = position.into_iter().chain(quaternion).collect::<Vec<_>>().join(", ");
        SceneError::bad(file, "site", actual, "a finite position_m and a quaternion of length 1")
    })?;
    let scan = file.parent().unwrap_or(Path::new("")).join(&site.scan);
    Ok(SitePlacement { scan, metres_per_unit: site.metres_per_unit, world_from_scan })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_without_a_rotation_has_its_position_alone_and_a_false_rotation_is_refused() {
        let table = SiteTable { scan: "a.ply".to_owned(), position_m: Some([1.0, 2.0, 3.0]), ..SiteTable::default() };
        let placement = read_site(Path::new("scenes/case.toml"), &table).unwrap();
        assert_eq!(placement.scan, Path::new("scenes/a.ply"));
        assert_eq!(placement.world_from_scan, Pose::new(DQuat::IDENTITY, DVec3::new(1.0, 2.0, 3.0)));
        let false_rotation = SiteTable { quaternion: Some([0.0; 4]), ..table };
        let error = read_site(Path::new("case.toml"), &false_rotation).unwrap_err().to_string();
        let expected = "found position_m [1, 2, 3], quaternion [0, 0, 0, 0]; expected: a finite position_m";
        assert!(error.contains(expected), "{error}");
    }
}
