//! Composited pixels that are read back before they are coded, and coded on the processor: on a
//! software adapter, where the passes of coding and noise take several times as long.

use super::on_cpu::{CpuCoding, RegionPlace, UncodedTexel, UncodedTexels};
use super::{CodedPiece, UncodedRegion, composite_region};
use crate::compositor::mix::{MixInputs, corners_in};
use crate::compositor::rgba::rgba;
use crate::gpu::{Gpu, GpuError, PassRecorder, Readback, ReadbackSet, Texture};
use crate::pixels::{Codes, Pixels, Rect};

/// A piece of a picture that is coded once it is read back.
#[derive(Debug)]
pub struct PendingCoding {
    coding: CpuCoding,
    /// Rectangle of the region in the picture, and the piece's.
    region: Rect,
    piece: Rect,
    /// R'G'B' codes that are not clipped, with the changed share; then the amplitude factors of
    /// noise, if there is any.
    readbacks: Vec<Readback>,
}

/// Records the composite of a piece and its readback. Returns `None` if no pixel changes.
pub fn composite_uncoded(
    recorder: &mut PassRecorder,
    readbacks: &mut ReadbackSet,
    inputs: &MixInputs<'_>,
    coded: &CodedPiece<'_>,
) -> Option<PendingCoding> {
    let CodedPiece { region, piece, changed, noise, .. } = *coded;
    let tiles = region.tiles(changed);
    if tiles.is_empty() {
        return None;
    }
    let size = (region.rect.width(), region.rect.height());
    let UncodedRegion { codes, amplitude_factor } = composite_region(recorder, inputs, coded, &tiles);
    let textures = [Some(&codes), amplitude_factor.as_ref()].into_iter().flatten();
    let readbacks = textures.map(|texture| recorder.read_back(readbacks, texture, size)).collect();
    let place = RegionPlace { size: [size.0 as usize, size.1 as usize], extent: region.extent() };
    let corners = corners_in(&tiles, region.rect);
    let coding = CpuCoding::new(region.coding, region.uniform(0, 1), place, &corners, noise);
    Some(PendingCoding { coding, region: region.rect, piece: piece.rect, readbacks })
}

impl PendingCoding {
    pub fn readbacks(&self) -> &[Readback] {
        &self.readbacks
    }

    pub fn readbacks_mut(&mut self) -> &mut [Readback] {
        &mut self.readbacks
    }

    pub fn into_readbacks(self) -> Vec<Readback> {
        self.readbacks
    }

    /// Waits, then writes the codes of changed pixels into the picture.
    pub fn paste(&self, gpu: &Gpu, pixels: &mut Pixels) -> Result<(), GpuError> {
        let picture_width = pixels.width as usize;
        let Codes::U8(picture) = &mut pixels.codes else { return Ok(()) };
        let codes = self.codes(gpu)?;
        for (y, row) in (self.piece.y0..self.piece.y1).zip(self.rows(&codes)) {
            let first = y as usize * picture_width + self.piece.x0 as usize;
            let out = picture[3 * first..].as_chunks_mut::<3>().0.iter_mut();
            for (out, [r, g, b, changed]) in out.zip(row) {
                if *changed != 0 {
                    *out = [*r, *g, *b];
                }
            }
        }
        Ok(())
    }

    /// Waits, then returns the piece of the picture as a texture.
    pub fn texture(&self, recorder: &PassRecorder, pixels: &Pixels) -> Result<Texture, GpuError> {
        let size = (self.piece.width(), self.piece.height());
        let out = recorder.pool.lend_to_write(&recorder.gpu, size, wgpu::TextureFormat::Rgba8Uint);
        let Codes::U8(picture) = &pixels.codes else { return Ok(out) };
        let codes = self.codes(&recorder.gpu)?;
        let mut texels = rgba(picture, (pixels.width, pixels.height), self.piece, |code| code);
        let rows = texels.chunks_exact_mut(size.0 as usize).zip(self.rows(&codes));
        for (texel, code) in rows.flat_map(|(texels, row)| texels.iter_mut().zip(row)) {
            if code[3] != 0 {
                *texel = *code;
            }
        }
        out.write(&recorder.gpu, size.0, size.1, &texels);
        Ok(out)
    }

    /// Rows of the piece.
    fn rows<'a>(&self, codes: &'a [[u8; 4]]) -> impl Iterator<Item = &'a [[u8; 4]]> + use<'a> {
        let [left, top] = [self.piece.x0 - self.region.x0, self.piece.y0 - self.region.y0].map(|v| v as usize);
        let columns = left..left + self.piece.width() as usize;
        let rows = codes.chunks_exact(self.region.width() as usize).skip(top);
        rows.take(self.piece.height() as usize).map(move |row| &row[columns.clone()])
    }

    /// Waits, then returns the codes of the region's pixels.
    fn codes(&self, gpu: &Gpu) -> Result<Vec<[u8; 4]>, GpuError> {
        let [width, height] = self.coding.size();
        let mut texels: Vec<UncodedTexel> = vec![[0.0; 4]; width * height];
        let mut factors: Vec<f32> = vec![0.0; if self.coding.has_noise() { width * height } else { 0 }];
        let targets = [bytemuck::cast_slice_mut(&mut texels), bytemuck::cast_slice_mut(&mut factors)];
        for (readback, target) in self.readbacks.iter().zip(targets) {
            let target: &mut [u8] = target;
            let row_bytes = target.len() / height;
            readback.rows(gpu, |row, bytes| target[row * row_bytes..][..row_bytes].copy_from_slice(bytes))?;
        }
        Ok(self.coding.code(&UncodedTexels { codes: &texels, amplitude_factors: &factors }))
    }
}
