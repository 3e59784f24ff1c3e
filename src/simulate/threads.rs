//! Rows of a picture over threads.

use std::sync::Mutex;

/// Rows handed out at a time: few enough that threads end together.
const BAND: usize = 8;

/// Fills `values`, `row_length` a row, by calling `fill(first row, rows)` for bands of rows on
/// `threads` threads. What `fill` writes must depend on the rows' place alone.
pub fn over_rows<T: Send>(values: &mut [T], row_length: usize, threads: usize, fill: impl Fn(usize, &mut [T]) + Sync) {
    let bands = Mutex::new(values.chunks_mut((row_length * BAND).max(1)).enumerate());
    std::thread::scope(|scope| {
        let work = || {
            // A poisoned lock means that `fill` panicked elsewhere; the scope passes that on.
            while let Some((band, rows)) = bands.lock().ok().and_then(|mut bands| bands.next()) {
                fill(band * BAND, rows);
            }
        };
        // Where a thread cannot be had, those that there are do its share; rayon's pool would panic.
        for _ in 1..threads {
            let _ = std::thread::Builder::new().spawn_scoped(scope, work);
        }
        work();
    });
}
