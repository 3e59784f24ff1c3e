//! Occlusion of drawn objects by the real scene, from its depth at one moment, or at each moment of
//! a sum.

use crate::depth::DepthGrid;
use crate::gpu::{PassRecorder, Texture};
use crate::pixels::Rect;

use super::plan::RenderSample;

/// Depth of the real scene.
#[derive(Clone, Copy, Debug)]
pub struct Occlusion<'a> {
    /// Depth over the drawn rectangle (metres, 0 unknown).
    pub depth: &'a Texture,
    /// Placement of a depth map with its own resolution; otherwise it has the picture's pixels.
    pub grid_placement: Option<GridPlacement>,
    /// Depth margin by which a real surface must be nearer to occlude, metres.
    pub tolerance_m: f32,
    /// Depth maps by time, in seconds relative to the picture. A sample uses the nearest in time.
    /// Empty if `depth` applies to all samples.
    pub moments: &'a [(f64, DepthGrid)],
}

impl<'a> Occlusion<'a> {
    /// Index of the moment nearest to a sample.
    fn nearest(&self, sample: &RenderSample) -> Option<usize> {
        let far = |n: &usize| (self.moments[*n].0 - sample.time_s).abs();
        (0..self.moments.len()).min_by(|a, b| far(a).total_cmp(&far(b)))
    }

    /// The samples of a plan, grouped by moment.
    pub fn grouped_by_moment<'s>(this: Option<&Self>, samples: &'s [RenderSample]) -> Vec<&'s RenderSample> {
        let mut samples: Vec<&RenderSample> = samples.iter().collect();
        if let Some(own) = this.filter(|own| !own.moments.is_empty()) {
            samples.sort_by_key(|sample| own.nearest(sample));
        }
        samples
    }

    /// Occlusion of a sample. `cached` is the last moment's depth. No memo: it lasts for one
    /// drawing.
    pub fn of<'h>(
        &self,
        sample: &RenderSample,
        recorder: &PassRecorder,
        drawn: Rect,
        cached: &'h mut Option<(usize, (Texture, Option<GridPlacement>))>,
    ) -> Occlusion<'h>
    where
        'a: 'h,
    {
        if let Some(n) = self.nearest(sample)
            && cached.as_ref().is_none_or(|(last, _)| *last != n)
        {
            *cached = Some((n, grid_depth(recorder, &self.moments[n].1, drawn, self.grid_placement.is_none())));
        }
        match cached {
            Some((_, (depth, grid_placement))) => {
                Occlusion { depth, grid_placement: *grid_placement, moments: &[], ..*self }
            }
            None => Occlusion { moments: &[], ..*self },
        }
    }
}

/// Placement of a depth texture in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPlacement {
    /// Index of its first texel, counted from the picture's corner.
    pub first: [i32; 2],
    /// Texels per pixel.
    pub per_pixel: f64,
}

impl GridPlacement {
    /// Texel coordinates of a pixel's corner.
    pub fn of_pixel(&self, at: [i32; 2]) -> [f32; 2] {
        [0, 1].map(|axis| (f64::from(at[axis]) * self.per_pixel - f64::from(self.first[axis])) as f32)
    }
}

/// Uploads a photograph's depth around a rectangle (metres, 0 unknown): at the resolution of its
/// grid, or of the photograph.
pub fn grid_depth(
    recorder: &PassRecorder,
    grid: &DepthGrid,
    drawn: Rect,
    by_pixel: bool,
) -> (Texture, Option<GridPlacement>) {
    if by_pixel {
        return (real_depth(recorder, &grid.depth_m_in(drawn), drawn), None);
    }
    let (covered, texels) = grid.covering(drawn);
    let placed = GridPlacement { first: [covered.x0, covered.y0], per_pixel: grid.enlargement.recip() };
    (real_depth(recorder, &texels, covered), Some(placed))
}

/// Uploads depth over a rectangle (metres, 0 unknown).
pub fn real_depth(recorder: &PassRecorder, texels: &[f32], drawn: Rect) -> Texture {
    let size = (drawn.width(), drawn.height());
    let texture = recorder.pool.lend_to_write(&recorder.gpu, size, wgpu::TextureFormat::R32Float);
    texture.write(&recorder.gpu, size.0, size.1, texels);
    texture
}
