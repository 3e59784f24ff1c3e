//! Tiles of a picture that can change. Most of the rectangle around objects and their shadows is
//! empty, at the full cost per pixel.

use crate::pixels::Rect;

/// Side of the picture's tiles, px.
pub const TILE_PX: i32 = 16;

/// The tiles of `area` that intersect `changed`, with runs of a row joined. They cover each pixel
/// of `changed` once.
pub fn dirty_tiles(area: Rect, changed: &[Rect]) -> Vec<Rect> {
    tiles_on_grid(area, [0, 0], changed)
}

/// [`dirty_tiles`] of a grid with a corner at `origin`.
pub fn tiles_on_grid(area: Rect, [x, y]: [i32; 2], changed: &[Rect]) -> Vec<Rect> {
    let changed: Vec<Rect> = changed.iter().map(|rect| rect.moved(-x, -y)).collect();
    let tiles = tiles_at_origin(area.moved(-x, -y), &changed);
    tiles.into_iter().map(|tile| tile.moved(x, y)).collect()
}

fn tiles_at_origin(area: Rect, changed: &[Rect]) -> Vec<Rect> {
    let first = |edge: i32| edge.div_euclid(TILE_PX);
    let (x0, y0) = (first(area.x0), first(area.y0));
    let (columns, rows) =
        ((first(area.x1 - 1) + 1 - x0).max(0) as usize, (first(area.y1 - 1) + 1 - y0).max(0) as usize);
    let mut is_dirty = vec![false; columns * rows];
    for part in changed.iter().map(|rect| rect.intersection(&area)).filter(|part| !part.is_empty()) {
        for y in first(part.y0)..=first(part.y1 - 1) {
            let row = &mut is_dirty[(y - y0) as usize * columns..][..columns];
            row[(first(part.x0) - x0) as usize..=(first(part.x1 - 1) - x0) as usize].fill(true);
        }
    }
    let mut runs = Vec::new();
    for (y, row) in (y0..).zip(is_dirty.chunks(columns.max(1))) {
        let mut x = 0;
        for run in row.chunk_by(|a, b| a == b) {
            let edge = |n: usize| (x0 + n as i32) * TILE_PX;
            if run[0] {
                let run = Rect::new(edge(x), y * TILE_PX, edge(x + run.len()), (y + 1) * TILE_PX);
                runs.push(run.intersection(&area));
            }
            x += run.len();
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_that_intersect_rectangles_are_joined_to_runs() {
        let area = Rect::new(5, -3, 70, 40);
        let changed =
            [Rect::new(20, 0, 40, 10), Rect::new(60, 4, 99, 5), Rect::new(0, 20, 6, 21), Rect::new(80, 0, 90, 9)];
        let runs = [Rect::new(16, 0, 48, 16), Rect::new(48, 0, 70, 16), Rect::new(5, 16, 16, 32)];
        // The first two meet.
        let joined = [Rect::new(16, 0, 70, 16), runs[2]];
        assert_eq!(dirty_tiles(area, &changed), joined);
        assert_eq!(dirty_tiles(area, &changed[..1]), runs[..1]);
        assert!(dirty_tiles(area, &changed[3..]).is_empty() && dirty_tiles(Rect::new(3, 3, 3, 3), &changed).is_empty());
    }

    #[test]
    fn every_changed_pixel_is_in_exactly_one_run() {
        let area = Rect::new(-7, 9, 150, 101);
        let changed =
            [Rect::new(-20, 3, 8, 30), Rect::new(40, 40, 41, 90), Rect::new(90, 9, 97, 11), Rect::new(33, 60, 80, 61)];
        let runs = dirty_tiles(area, &changed);
        for (x, y) in (area.y0..area.y1).flat_map(|y| (area.x0..area.x1).map(move |x| (x, y))) {
            let count = runs.iter().filter(|run| run.contains(x, y)).count();
            assert!(count <= 1 && (count == 1 || !changed.iter().any(|rect| rect.contains(x, y))), "{x} {y}: {count}");
        }
    }
}
