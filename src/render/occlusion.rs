//! What real things hide as objects are drawn: by their depth at one moment, or at each of those that a picture sums.

use crate::depth::DepthGrid;
use crate::gpu::{Recorder, Texture};
use crate::pixels::Rect;

use super::plan::Sample;

/// The real scene's depth.
#[derive(Clone, Copy, Debug)]
pub struct Occlusion<'a> {
    /// Over the drawn rectangle (metres, 0 unknown).
    pub depth: &'a Texture,
    /// Its place, where it has pixels of its own; else they are the picture's.
    pub on_grid: Option<Placed>,
    /// How much nearer a real thing must be to hide, metres.
    pub tolerance_m: f32,
    /// Depth at moments, in seconds from the picture's. A drawing that is one of several has that of the nearest
    /// moment. Empty if `depth` is that of all of them.
    pub moments: &'a [(f64, DepthGrid)],
}

impl<'a> Occlusion<'a> {
    /// The number of the moment that is nearest to a drawing.
    fn nearest(&self, sample: &Sample) -> Option<usize> {
        let far = |n: &usize| (self.moments[*n].0 - sample.time_s).abs();
        (0..self.moments.len()).min_by(|a, b| far(a).total_cmp(&far(b)))
    }

    /// The drawings of a plan so that those of one moment follow each other.
    pub fn in_turn<'s>(this: Option<&Self>, samples: &'s [Sample]) -> Vec<&'s Sample> {
        let mut samples: Vec<&Sample> = samples.iter().collect();
        if let Some(own) = this.filter(|own| !own.moments.is_empty()) {
            samples.sort_by_key(|sample| own.nearest(sample));
        }
        samples
    }

    /// What hides in a drawing. `held` is the last moment's depth, and is replaced where the drawing's is another.
    pub fn of<'h>(
        &self,
        sample: &Sample,
        recorder: &Recorder,
        drawn: Rect,
        held: &'h mut Option<(usize, (Texture, Option<Placed>))>,
    ) -> Occlusion<'h>
    where
        'a: 'h,
    {
        if let Some(n) = self.nearest(sample)
            && held.as_ref().is_none_or(|(last, _)| *last != n)
        {
            *held = Some((n, grid_depth(recorder, &self.moments[n].1, drawn, self.on_grid.is_none())));
        }
        match held {
            Some((_, (depth, on_grid))) => Occlusion { depth, on_grid: *on_grid, moments: &[], ..*self },
            None => Occlusion { moments: &[], ..*self },
        }
    }
}

/// Where a texture of depths lies in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Its first texel, of those that are counted from the picture's corner.
    pub first: [i32; 2],
    /// Texels per pixel.
    pub per_pixel: f64,
}

impl Placed {
    /// The place of a pixel's corner, texels.
    pub fn of_pixel(&self, at: [i32; 2]) -> [f32; 2] {
        [0, 1].map(|axis| (f64::from(at[axis]) * self.per_pixel - f64::from(self.first[axis])) as f32)
    }
}

/// A photograph's depth around a rectangle of it (metres, 0 unknown) on the GPU: by the pixels of its grid, or of the photograph.
pub fn grid_depth(recorder: &Recorder, grid: &DepthGrid, drawn: Rect, by_pixel: bool) -> (Texture, Option<Placed>) {
    if by_pixel {
        return (real_depth(recorder, &grid.over(drawn), drawn), None);
    }
    let (around, texels) = grid.around(drawn);
    let placed = Placed { first: [around.x0, around.y0], per_pixel: grid.enlargement.recip() };
    (real_depth(recorder, &texels, around), Some(placed))
}

/// Depth over a rectangle (metres, 0 unknown) on the GPU.
pub fn real_depth(recorder: &Recorder, texels: &[f32], drawn: Rect) -> Texture {
    let size = (drawn.width(), drawn.height());
    let texture = recorder.pool.lend_to_write(&recorder.gpu, size, wgpu::TextureFormat::R32Float);
    texture.write(&recorder.gpu, size.0, size.1, texels);
    texture
}
