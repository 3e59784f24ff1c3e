//! Rectangles of a frame's work: the drawn layer, the shadow mask, and the pieces to composite.

use super::mix::CompositePiece;
use crate::pixels::Rect;

/// Alignment of the layer, for effects at lower resolutions, px: a multiple of a photograph's tiles
/// and of the coarsest pixels, both 16 px.
const GRID_PX: i32 = 32;

/// The inputs of [`WorkRects`].
#[derive(Clone, Copy, Debug)]
pub struct WorkRequest {
    /// Rectangle of the picture to composite.
    pub region: Rect,
    /// Bounds of the objects while the shutter is open.
    pub footprint: Rect,
    /// Bounds of their shadows on real surfaces.
    pub shadowed: Rect,
    /// Radius over which effects read, px, summed over the effects.
    pub reach_px: i32,
    /// Distance beyond the objects to which effects spread light, px, summed over the effects.
    pub spread_px: i32,
    /// A 360° picture, whose left and right rims meet.
    pub is_equirectangular: bool,
    /// Whether the whole region is composited, even without anything virtual.
    pub is_whole: bool,
    /// Whether effects act on real pixels too.
    pub acts_on_real: bool,
}

/// Rectangles of a frame, px of the output picture.
#[derive(Debug)]
pub struct WorkRects {
    /// The layer's rectangle; may extend beyond the picture.
    pub drawn: Rect,
    /// The shadow mask's rectangle; may be empty.
    pub shadowed: Rect,
    /// Bounds of the objects with the light that effects spread.
    pub objects_px: Rect,
    /// Distance to which effects spread light beyond the objects, px.
    pub spread_px: i32,
    /// Pieces to composite; at least one.
    pub pieces: Vec<CompositePiece>,
    /// Bounds of the composited pixels. Across the seam, x1 exceeds the picture's width.
    pub bounds: Rect,
}

impl WorkRects {
    /// `None` if there is nothing to do.
    pub fn of(request: &WorkRequest) -> Option<Self> {
        let WorkRequest { region, is_equirectangular, reach_px, .. } = *request;
        let width = region.width() as i32;
        // Objects outside the picture whose blur reaches into it are drawn too.
        let mut reach = region.grown(reach_px);
        if is_equirectangular {
            // Columns continue across the seam.
            (reach.x0, reach.x1) = (-width, 2 * width);
        }
        let objects_px =
            if request.footprint.is_empty() { request.footprint } else { request.footprint.grown(request.spread_px) };
        // Across a seam, and where effects read shadowed real pixels, mask and layer have the same
        // rectangle.
        let together = is_equirectangular || request.acts_on_real;
        let changed = if together { objects_px.union(&request.shadowed) } else { objects_px };
        let mut drawn = if request.acts_on_real { reach } else { changed.intersection(&reach) };
        if is_equirectangular && drawn.width() >= region.width() {
            (drawn.x0, drawn.x1) = (-reach_px, width + reach_px);
        }
        // The pixels of lower resolutions must be the same in every part of a photograph.
        let on_grid = |edge: i32| if request.is_whole { edge.div_euclid(GRID_PX) * GRID_PX } else { edge };
        let drawn = Rect { x0: on_grid(drawn.x0), y0: on_grid(drawn.y0), ..drawn };
        let shadowed = if request.shadowed.is_empty() {
            request.shadowed
        } else if together {
            drawn
        } else {
            request.shadowed.intersection(&reach)
        };
        let mut pieces = pieces(drawn, shadowed, region, is_equirectangular);
        let is_whole = request.is_whole && !region.is_empty();
        if pieces.is_empty() && !is_whole {
            return None;
        }
        // A layer has at least one pixel.
        let none = drawn.is_empty() || pieces.is_empty();
        let first = if shadowed.intersection(&region).is_empty() { region } else { shadowed.intersection(&region) };
        let drawn = if none { Rect::new(first.x0, first.y0, first.x0 + 1, first.y0 + 1) } else { drawn };
        if is_whole {
            pieces = vec![CompositePiece { rect: region, drawn, shadowed }];
        } else if none {
            pieces.iter_mut().for_each(|piece| piece.drawn = drawn);
        }
        let bounds = match pieces.as_slice() {
            [one] => one.rect,
            _ => drawn.intersection(&Rect { x0: reach.x0, x1: reach.x1, ..region }),
        };
        Some(Self { drawn, shadowed, objects_px, spread_px: request.spread_px, pieces, bounds })
    }
}

/// The pieces of the picture that a layer and its shadow mask cover. In a 360° picture, columns
/// beyond a rim continue at the opposite one.
fn pieces(drawn: Rect, shadowed: Rect, region: Rect, is_equirectangular: bool) -> Vec<CompositePiece> {
    let width = region.width() as i32;
    // A layer that spans the whole picture already contains the columns beyond the rims.
    let turns: &[i32] = if is_equirectangular && (drawn.width() as i32) < width { &[0, 1, -1] } else { &[0] };
    let piece = |turn: &i32| {
        let [drawn, shadowed] = [drawn, shadowed].map(|rect| rect.moved(-turn * width, 0));
        CompositePiece { rect: drawn.union(&shadowed).intersection(&region), drawn, shadowed }
    };
    turns.iter().map(piece).filter(|piece| !piece.rect.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(footprint: Rect) -> WorkRequest {
        WorkRequest {
            region: Rect::new(0, 0, 100, 50),
            footprint,
            shadowed: Rect::new(0, 0, 0, 0),
            reach_px: 10,
            spread_px: 4,
            is_equirectangular: false,
            is_whole: false,
            acts_on_real: false,
        }
    }

    #[test]
    fn object_beside_the_picture_is_drawn_as_far_as_its_blur_reaches_into_it() {
        let rects = WorkRects::of(&request(Rect::new(-30, 10, 20, 20))).unwrap();
        assert_eq!(rects.drawn, Rect::new(-10, 6, 24, 24));
        assert_eq!(rects.bounds, Rect::new(0, 6, 24, 24));
        assert_eq!(rects.pieces.len(), 1);
        assert!(WorkRects::of(&request(Rect::new(-30, 10, -20, 20))).is_none());
        assert!(WorkRects::of(&request(Rect::new(0, 0, 0, 0))).is_none());
    }

    #[test]
    fn shadow_mask_and_layer_have_separate_rectangles_unless_they_must_coincide() {
        let shadowed = Rect::new(60, 20, 90, 70);
        let beside = WorkRequest { shadowed, ..request(Rect::new(10, 10, 20, 20)) };
        let rects = WorkRects::of(&beside).unwrap();
        assert_eq!((rects.drawn, rects.shadowed), (Rect::new(6, 6, 24, 24), Rect::new(60, 20, 90, 60)));
        assert_eq!(rects.pieces[0].rect, Rect::new(6, 6, 90, 50));
        // Without objects, the layer is one pixel.
        let rects = WorkRects::of(&WorkRequest { footprint: Rect::new(0, 0, 0, 0), ..beside }).unwrap();
        let pixel = Rect::new(60, 20, 61, 21);
        assert_eq!((rects.drawn, rects.pieces[0].drawn), (pixel, pixel));
        assert_eq!(rects.pieces[0].rect, Rect::new(60, 20, 90, 50));
        // Across a seam, and under effects that act on real pixels, they coincide.
        for beside in [WorkRequest { acts_on_real: true, ..beside }, WorkRequest { is_equirectangular: true, ..beside }]
        {
            let rects = WorkRects::of(&beside).unwrap();
            assert_eq!(rects.drawn, rects.shadowed);
            assert_eq!(rects.drawn.union(&shadowed.intersection(&beside.region)), rects.drawn);
        }
    }

    #[test]
    fn object_across_the_seam_yields_a_piece_at_each_rim() {
        let rects =
            WorkRects::of(&WorkRequest { is_equirectangular: true, ..request(Rect::new(90, 10, 110, 20)) }).unwrap();
        assert_eq!(rects.drawn, Rect::new(86, 6, 114, 24));
        let composited: Vec<_> = rects.pieces.iter().map(|piece| piece.rect).collect();
        assert_eq!(composited, [Rect::new(86, 6, 100, 24), Rect::new(0, 6, 14, 24)]);
    }

    #[test]
    fn whole_region_of_a_photograph_is_composited() {
        let empty = WorkRequest { is_whole: true, ..request(Rect::new(0, 0, 0, 0)) };
        let rects = WorkRects::of(&empty).unwrap();
        assert_eq!((rects.pieces[0].rect, rects.drawn), (empty.region, Rect::new(0, 0, 1, 1)));
        let rects = WorkRects::of(&WorkRequest { acts_on_real: true, ..empty }).unwrap();
        assert_eq!(rects.drawn, Rect::new(-32, -32, 110, 60));
    }
}
