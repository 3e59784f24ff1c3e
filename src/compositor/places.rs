//! Where a frame's work takes place: what is drawn, and which pieces of the picture are composited.

use super::mix::Piece;
use crate::pixels::Rect;

/// Alignment for effects that work at lower resolutions: a multiple of a photograph's tiles and of the coarsest pixels,
/// both 16 px.
const GRID_PX: i32 = 32;

/// The inputs of `Places`.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The columns and rows of the picture that may be made.
    pub region: Rect,
    /// Where objects can be while the shutter is open.
    pub footprint: Rect,
    /// Where they shade real surfaces.
    pub shaded: Rect,
    /// How far effects look, and how far beyond the objects they draw, px, summed over the effects.
    pub reach_px: i32,
    pub spread_px: i32,
    /// A 360° picture, whose left and right rims meet.
    pub round: bool,
    /// Whether all of the region is made, even where nothing virtual is.
    pub whole: bool,
    /// Whether effects act on the real part too.
    pub real_too: bool,
}

#[derive(Debug)]
pub struct Places {
    /// The layer's rectangle; may extend beyond the picture.
    pub drawn: Rect,
    /// That of the shade; may be empty.
    pub shaded: Rect,
    /// Where something virtual can be.
    pub objects_px: Rect,
    /// How far beyond the objects themselves, px.
    pub spread_px: i32,
    /// At least one.
    pub pieces: Vec<Piece>,
    /// For a rectangle across the seam, x1 exceeds the picture's width.
    pub looked_at: Rect,
}

impl Places {
    /// `None` if there is nothing to do.
    pub fn of(asked: &Asked) -> Option<Self> {
        let Asked { region, round, reach_px, .. } = *asked;
        let width = region.width() as i32;
        // Objects outside the picture that can be seen in it are drawn too.
        let mut reach = region.grown(reach_px);
        if round {
            // Columns continue across the seam.
            (reach.x0, reach.x1) = (-width, 2 * width);
        }
        let objects_px =
            if asked.footprint.is_empty() { asked.footprint } else { asked.footprint.grown(asked.spread_px) };
        // Across a seam, and where effects see shaded real things, shade and layer lie over the same pixels.
        let together = round || asked.real_too;
        let touched = if together { objects_px.union(&asked.shaded) } else { objects_px };
        let mut drawn = if asked.real_too { reach } else { touched.intersection(&reach) };
        if round && drawn.width() >= region.width() {
            (drawn.x0, drawn.x1) = (-reach_px, width + reach_px);
        }
        // Lower resolutions have larger pixels, which must be the same in every part of a photograph.
        let on_grid = |edge: i32| if asked.whole { edge.div_euclid(GRID_PX) * GRID_PX } else { edge };
        let drawn = Rect { x0: on_grid(drawn.x0), y0: on_grid(drawn.y0), ..drawn };
        let shaded = match asked.shaded.is_empty() {
            true => asked.shaded,
            false if together => drawn,
            false => asked.shaded.intersection(&reach),
        };
        let mut pieces = pieces(drawn, shaded, region, round);
        let whole = asked.whole && !region.is_empty();
        if pieces.is_empty() && !whole {
            return None;
        }
        // A layer has a pixel at least: one where something is done.
        let none = drawn.is_empty() || pieces.is_empty();
        let first = if shaded.intersection(&region).is_empty() { region } else { shaded.intersection(&region) };
        let drawn = if none { Rect::new(first.x0, first.y0, first.x0 + 1, first.y0 + 1) } else { drawn };
        if whole {
            pieces = vec![Piece { shown: region, drawn, shaded }];
        } else if none {
            pieces.iter_mut().for_each(|piece| piece.drawn = drawn);
        }
        let looked_at = match pieces.as_slice() {
            [one] => one.shown,
            _ => drawn.intersection(&Rect { x0: reach.x0, x1: reach.x1, ..region }),
        };
        Some(Self { drawn, shaded, objects_px, spread_px: asked.spread_px, pieces, looked_at })
    }
}

/// The pieces of the picture that a layer and its shade cover. In a 360° picture, what is beyond a rim appears at the opposite
/// one.
fn pieces(drawn: Rect, shaded: Rect, region: Rect, round: bool) -> Vec<Piece> {
    let width = region.width() as i32;
    // A layer that spans the whole picture already contains what is beyond the rims.
    let turns: &[i32] = if round && (drawn.width() as i32) < width { &[0, 1, -1] } else { &[0] };
    let piece = |turn: &i32| {
        let [drawn, shaded] = [drawn, shaded].map(|rect| rect.moved(-turn * width, 0));
        Piece { shown: drawn.union(&shaded).intersection(&region), drawn, shaded }
    };
    turns.iter().map(piece).filter(|piece| !piece.shown.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(footprint: Rect) -> Asked {
        Asked {
            region: Rect::new(0, 0, 100, 50),
            footprint,
            shaded: Rect::new(0, 0, 0, 0),
            reach_px: 10,
            spread_px: 4,
            round: false,
            whole: false,
            real_too: false,
        }
    }

    #[test]
    fn beside_the_picture_is_drawn_what_reaches_into_it() {
        let places = Places::of(&asked(Rect::new(-30, 10, 20, 20))).unwrap();
        assert_eq!(places.drawn, Rect::new(-10, 6, 24, 24));
        assert_eq!(places.looked_at, Rect::new(0, 6, 24, 24));
        assert_eq!(places.pieces.len(), 1);
        assert!(Places::of(&asked(Rect::new(-30, 10, -20, 20))).is_none());
        assert!(Places::of(&asked(Rect::new(0, 0, 0, 0))).is_none());
    }

    #[test]
    fn a_shade_needs_no_layer_and_a_layer_no_shade() {
        let shaded = Rect::new(60, 20, 90, 70);
        let beside = Asked { shaded, ..asked(Rect::new(10, 10, 20, 20)) };
        let places = Places::of(&beside).unwrap();
        assert_eq!((places.drawn, places.shaded), (Rect::new(6, 6, 24, 24), Rect::new(60, 20, 90, 60)));
        assert_eq!(places.pieces[0].shown, Rect::new(6, 6, 90, 50));
        // Where nothing is drawn, a pixel of the layer is.
        let places = Places::of(&Asked { footprint: Rect::new(0, 0, 0, 0), ..beside }).unwrap();
        let pixel = Rect::new(60, 20, 61, 21);
        assert_eq!((places.drawn, places.pieces[0].drawn), (pixel, pixel));
        assert_eq!(places.pieces[0].shown, Rect::new(60, 20, 90, 50));
        // Across a seam, and under effects that see the real part, they are together.
        for beside in [Asked { real_too: true, ..beside }, Asked { round: true, ..beside }] {
            let places = Places::of(&beside).unwrap();
            assert_eq!(places.drawn, places.shaded);
            assert_eq!(places.drawn.union(&shaded.intersection(&beside.region)), places.drawn);
        }
    }

    #[test]
    fn across_a_seam_both_rims_are_made() {
        let places = Places::of(&Asked { round: true, ..asked(Rect::new(90, 10, 110, 20)) }).unwrap();
        assert_eq!(places.drawn, Rect::new(86, 6, 114, 24));
        let shown: Vec<_> = places.pieces.iter().map(|piece| piece.shown).collect();
        assert_eq!(shown, [Rect::new(86, 6, 100, 24), Rect::new(0, 6, 14, 24)]);
    }

    #[test]
    fn all_of_a_photograph_is_made() {
        let empty = Asked { whole: true, ..asked(Rect::new(0, 0, 0, 0)) };
        let places = Places::of(&empty).unwrap();
        assert_eq!((places.pieces[0].shown, places.drawn), (empty.region, Rect::new(0, 0, 1, 1)));
        let places = Places::of(&Asked { real_too: true, ..empty }).unwrap();
        assert_eq!(places.drawn, Rect::new(-32, -32, 110, 60));
    }
}
