//! Parameters of the depth of field and the range of circles of confusion, which all methods share.

use super::operator::Shape;
use crate::effects::FrameContext;

/// Diameter below which circles count as points, px.
pub const SHARP_PX: f32 = 0.7;
/// Largest diameter that is drawn, px: 12.5 texels to each side at a sixteenth, the size of the
/// shader's table.
pub const MAX_CIRCLE_PX: f32 = 400.0;

crate::choices! {
    /// Method of depth of field.
    pub enum Method { Layered = "layered", Poisson = "poisson", Diffusion = "diffusion", Reference = "reference" }
}

crate::choices! {
    /// Combination of light from different depths in the method `diffusion`.
    pub enum Mix { Conserving = "conserving", Printed = "printed" }
}

crate::params! {
    /// Parameters of the depth of field. The lens is in `camera.lens`.
    pub struct DepthOfField in "depth_of_field" at Effects {
        "layered: smooth discs, near and far apart; poisson: scattered points, may look grainy; diffusion: discs, stars or hearts; reference: through many points of the lens, accurate and slow"
        method at Draw: Method = Method::Layered;
        "poisson: number of points in the first disc"
        points: u32 = 48, "1", 8.0..=64.0 => method is "poisson";
        "diffusion: lens (its blades or circle), star (as many points as blades, else 5) or heart"
        shape: Shape = Shape::Lens => method is "diffusion";
        "diffusion: extra brightness of the rim per px of radius (lambda)"
        rim: f32 = 0.02, "1/px", 0.0..=1.0 => method is "diffusion";
        "diffusion: standard deviation of the Gaussian that smooths the shape"
        gaussian_px as "Gaussian σ": f32 = 0.5, "px", 0.0..=4.0 => method is "diffusion";
        "diffusion: largest drawn shape (R_K)"
        largest_radius_px: f32 = 36.0, "px", 1.0..=64.0 => method is "diffusion";
        "diffusion: conserving preserves the total light; printed: brightens equal lights that overlap, and loses others"
        mix: Mix = Mix::Conserving => method is "diffusion";
        "diffusion: K of the printed mix"
        mix_ratio: f32 = 0.7, "1", 0.0..=1.0 => mix is "printed";
        "diffusion: below this blur factor (0 to 1) the original is mixed in (w)"
        blend_below: f32 = 0.1, "1", 0.0..=1.0 => method is "diffusion";
    }
}

/// Diameters of the circles of everything drawn, px: the smallest and the largest.
pub fn circles_px(context: &FrameContext<'_>) -> [f32; 2] {
    let Some(opening) = context.capture.opening else { return [0.0; 2] };
    let [nearest, farthest] = context.depths_m;
    let depths_m = context.real_depths_m.map_or([nearest, farthest], |[n, f]| [n.min(nearest), f.max(farthest)]);
    let [near, far] = depths_m.map(|depth| opening.circle_px(context.picture.intrinsics.fx_px, depth) as f32);
    let smallest = if near * far > 0.0 { near.abs().min(far.abs()) } else { 0.0 };
    [smallest, near.abs().max(far.abs())]
}
