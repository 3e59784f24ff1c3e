//! Export of a shot's camera, and of its evidence, to other programs: Nuke's `.chan`, USD, glTF;
//! the lens as ST maps. docs/export.md documents every convention.

mod format;
mod glb;
mod glb_scene;
mod glb_writer;
mod plan;
mod plate;
mod readme;
mod shot_camera;
mod st_map;
mod texture;
mod usd_scene;
mod usd_writer;
mod usda;

pub use format::CameraFormat;
pub use plan::{CameraExport, CameraExportPlan};
pub use plate::PlateError;
