//! Renders the scene with a sample plan into the virtual layer.

mod accumulate;
mod albedo;
mod around;
mod around_bounds;
mod bounds;
mod dice;
mod draw;
mod in_view;
mod irradiance;
mod lens_table;
mod light;
mod lightmap;
mod material;
mod meshes;
mod motion;
mod occlusion;
pub(crate) mod panorama;
mod pipeline;
mod plan;
mod projected;
mod resample;
mod unwrap;
mod view;

pub use accumulate::max_area_px as largest_sum_px;
pub use bounds::Footprint;
pub use draw::Renderer;
pub use light::{MAX_POINTS, MAX_SUNS};
pub use lightmap::Lightmap;
pub use occlusion::{GridPlacement, Occlusion, grid_depth, real_depth};
pub use pipeline::{COLOR, GEOMETRY};
pub use plan::{Layer, RealLayer, RenderSample, SamplePlan};
pub use projected::{PictureRequest, Projection, take_still};
pub use resample::limits;
pub use unwrap::{LightmapVertex, TexelPoint, UnwrappedMesh};
pub use view::{Shutter, View, ViewKeys};
