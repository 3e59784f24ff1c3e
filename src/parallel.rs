//! Rows of pictures and other items, processed on several threads.

use std::sync::Mutex;

/// Bands of rows per thread: few enough that a band is worth its lock, enough that threads finish
/// together.
const BANDS: usize = 8;

/// How many threads the machine can run in parallel.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Fills `values`, `row_length` of them per row, by calling `fill(row number, row)` on `threads`
/// threads. The values must depend on the row number alone, so that no value depends on the number
/// of threads.
pub fn over_rows<T: Send>(values: &mut [T], row_length: usize, threads: usize, fill: impl Fn(usize, &mut [T]) + Sync) {
    let (row_length, threads) = (row_length.max(1), threads.max(1));
    let band = values.len().div_ceil(row_length).div_ceil(BANDS * threads).max(1);
    let bands = values.chunks_mut(row_length * band).enumerate().collect();
    over_items(bands, threads, |(n, rows): (usize, &mut [T])| {
        rows.chunks_mut(row_length).enumerate().for_each(|(y, row)| fill(n * band + y, row));
    });
}

/// Calls `work` for each item on `threads` threads.
pub fn over_items<T: Send>(items: Vec<T>, threads: usize, work: impl Fn(T) + Sync) {
    let threads = threads.clamp(1, items.len().max(1));
    let items = Mutex::new(items.into_iter());
    std::thread::scope(|scope| {
        let work = || {
            // A poisoned lock means that another thread panicked; the scope propagates that.
            while let Some(item) = items.lock().ok().and_then(|mut items| items.next()) {
                work(item);
            }
        };
        // If a thread cannot be spawned, the others do its share. In a pool the rows of a frame
        // would queue behind those of an analysis.
        for _ in 1..threads {
            let _ = std::thread::Builder::new().spawn_scoped(scope, work);
        }
        work();
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_item_is_processed_once_on_any_count_of_threads() {
        for (count, threads) in [(0, 2), (1, 8), (7, 0), (7, 1), (100, 3)] {
            let mut values = vec![0; count];
            over_items(values.iter_mut().enumerate().collect(), threads, |(i, value)| *value += i + 1);
            assert_eq!(values, (1..=count).collect::<Vec<_>>(), "{count} items on {threads} threads");
        }
    }

    #[test]
    fn each_row_is_filled_once_with_its_own_number_on_any_count_of_threads() {
        for (rows, threads) in [(0, 2), (1, 8), (7, 0), (7, 1), (100, 3), (1000, 16)] {
            let mut values = vec![0; 5 * rows];
            over_rows(&mut values, 5, threads, |y, row| {
                row.iter_mut().enumerate().for_each(|(x, v)| *v += 5 * y + x + 1)
            });
            assert_eq!(values, (1..=5 * rows).collect::<Vec<_>>(), "{rows} rows on {threads} threads");
        }
        over_rows(&mut [(); 0], 0, 2, |_, _| unreachable!("there are no rows"));
    }
}
