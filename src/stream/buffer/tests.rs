//! Tests of the reorder buffer.

use super::*;
use proptest::prelude::*;

fn timed_item(time_s: f64, arrived_s: f64, sequence: Option<u32>) -> TimedItem<()> {
    TimedItem { time_s, arrived_s, sequence, item: () }
}

fn out(buffer: &mut ReorderBuffer<()>, now_s: f64) -> Vec<(u32, f64, u32)> {
    std::iter::from_fn(|| buffer.pop(now_s)).map(|r| (r.epoch, r.timed.time_s, r.missed)).collect()
}

#[test]
fn items_in_order_do_not_wait_and_overtaken_ones_are_reordered() {
    let mut b = ReorderBuffer::new(0.02);
    assert_eq!(b.push(timed_item(5.00, 0.00, Some(1))), PushOutcome::Waits);
    // The very first item waits: it is unknown whether it is the first.
    assert_eq!(out(&mut b, 0.00), []);
    assert_eq!(b.due_s(), Some(0.02));
    assert_eq!(out(&mut b, 0.02), [(0, 5.00, 0)]);
    assert_eq!(b.push(timed_item(5.01, 0.03, Some(2))), PushOutcome::Waits);
    assert_eq!(out(&mut b, 0.03), [(0, 5.01, 0)]);
    // 4 overtakes 3.
    b.push(timed_item(5.03, 0.04, Some(4)));
    assert_eq!(out(&mut b, 0.045), []);
    b.push(timed_item(5.02, 0.05, Some(3)));
    assert_eq!(out(&mut b, 0.05), [(0, 5.02, 0), (0, 5.03, 0)]);
    // 5 is lost: 6 waits for it and is then released.
    b.push(timed_item(5.05, 0.06, Some(6)));
    assert_eq!(out(&mut b, 0.07), []);
    assert_eq!(out(&mut b, 0.08), [(0, 5.05, 1)]);
    // 5 arrives after all; 6 arrives twice.
    assert_eq!(b.push(timed_item(5.04, 0.09, Some(5))), PushOutcome::Late);
    assert_eq!(b.push(timed_item(5.05, 0.09, Some(6))), PushOutcome::Repeated);
    assert!(b.is_empty());
}

#[test]
fn clock_jump_begins_an_epoch_and_a_single_odd_time_does_not() {
    let mut b = ReorderBuffer::new(0.0);
    b.push(timed_item(100.0, 0.0, None));
    assert_eq!(b.push(timed_item(7.0, 0.1, None)), PushOutcome::Odd);
    assert_eq!(b.push(timed_item(100.2, 0.2, None)), PushOutcome::Waits);
    assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (0, 100.2, 0)]);
    // Back by 90 s, continuing from there.
    assert_eq!(b.push(timed_item(10.0, 0.3, None)), PushOutcome::Odd);
    assert!(
        matches!(b.push(timed_item(10.1, 0.4, None)), PushOutcome::Jumped { by_s, is_repeated: false } if (by_s + 90.3).abs() < 1e-9)
    );
    assert_eq!(out(&mut b, 0.4), [(1, 10.0, 0), (1, 10.1, 0)]);
    // Silence for an hour, on both clocks: no jump.
    assert_eq!(b.push(timed_item(3610.5, 3600.8, None)), PushOutcome::Waits);
}

#[test]
fn second_item_at_the_same_time_confirms_a_jump() {
    let mut b = ReorderBuffer::new(0.0);
    b.push(timed_item(100.0, 0.0, None));
    assert_eq!(b.push(timed_item(10.0, 0.1, None)), PushOutcome::Odd);
    assert!(matches!(b.push(timed_item(10.0, 0.11, None)), PushOutcome::Jumped { is_repeated: true, .. }));
    assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (1, 10.0, 0)]);
}

/// A range of items at 100 Hz on a clock 95 s ahead, each released on arrival.
fn steady(b: &mut ReorderBuffer<()>, numbers: std::ops::Range<u32>) {
    for i in numbers {
        let sent_s = 0.01 * f64::from(i);
        assert_eq!(b.push(timed_item(sent_s + 95.0, sent_s, Some(i))), PushOutcome::Waits);
        let released = std::iter::from_fn(|| b.pop(sent_s + 1.0)).last().unwrap();
        assert!((released.timed.time_s + released.offset_s - sent_s).abs() < 1e-9, "{released:?}");
    }
}

#[test]
fn single_stamp_ahead_is_odd_and_changes_nothing_after_it() {
    let mut b = ReorderBuffer::new(0.02);
    steady(&mut b, 0..200);
    assert_eq!(b.push(timed_item(2.0 + 95.1, 2.0, Some(200))), PushOutcome::Odd);
    steady(&mut b, 201..300);
}

#[test]
fn items_sent_faster_than_recorded_are_all_released() {
    for interval_s in [0.02, 0.1, 0.5] {
        let (mut b, mut times) = (ReorderBuffer::new(0.02), Vec::new());
        for i in 0..300 {
            b.push(timed_item(interval_s * f64::from(i), 0.001 * f64::from(i), Some(i)));
            times.extend(out(&mut b, 0.001 * f64::from(i)));
        }
        times.extend(out(&mut b, 9.0));
        assert_eq!(times.len(), 300, "{interval_s}");
    }
}

#[test]
fn clock_set_forward_is_followed_with_the_third_item() {
    let mut b = ReorderBuffer::new(0.02);
    steady(&mut b, 0..200);
    let ahead = |i: u32| timed_item(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
    assert_eq!((b.push(ahead(200)), b.push(ahead(201))), (PushOutcome::Odd, PushOutcome::Odd));
    let taken = b.push(ahead(202));
    assert!(
        matches!(taken, PushOutcome::Stepped { by_s, odd: 2, late: 0, repeated: 0, .. } if (by_s - 0.2).abs() < 1e-9),
        "{taken:?}"
    );
    let out: Vec<_> = std::iter::from_fn(|| b.pop(2.02)).map(|r| r.timed.time_s + r.offset_s).collect();
    assert!(out.iter().zip([2.0, 2.01, 2.02]).all(|(a, b)| (a - b).abs() < 1e-9) && out.len() == 3, "{out:?}");
}

/// Outcome of poses at 100 Hz, late by up to 3 ms, as the clock is stepped.
struct Step {
    missed: usize,
    /// Released with the time of another.
    mistimed: usize,
    /// Index (from 1) of the sample at which the step is reported, and the reported step,
    /// seconds.
    reported: Option<(u32, f64)>,
}

fn stepped(by_s: f64, is_numbered: bool) -> Step {
    let mut buffer = ReorderBuffer::new(0.02);
    let (mut released_count, mut mistimed, mut reported) = (0, 0, None);
    let mut random = 1_u32;
    for i in 0..600 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let sent_s = 0.01 * f64::from(i);
        let arrived_s = sent_s + 0.003 * f64::from(random >> 8) / f64::from(1 << 24);
        let time_s = sent_s + 95.0 + if i >= 200 { by_s } else { 0.0 };
        let sequence = is_numbered.then_some(i);
        match buffer.push(TimedItem { time_s, arrived_s, sequence, item: sent_s }) {
            PushOutcome::Stepped { by_s, .. } | PushOutcome::Jumped { by_s, .. } => {
                reported = reported.or(Some((i - 199, by_s)))
            }
            _ => {}
        }
        let now_s = if i == 599 { 99.0 } else { arrived_s };
        for released in std::iter::from_fn(|| buffer.pop(now_s)) {
            released_count += 1;
            let off_s = released.timed.time_s + released.offset_s - released.timed.item;
            mistimed += usize::from(off_s.abs() > 0.005);
        }
    }
    Step { missed: 600 - released_count, mistimed, reported }
}

#[test]
fn clock_step_loses_and_mistimes_no_pose() {
    for is_numbered in [true, false] {
        // Without numbers a step as long as the wait resembles overtaken items.
        let small_s = if is_numbered { -0.03 } else { -0.05 };
        for by_s in [-3.0, -0.5, -0.05, small_s, 0.1, 2.0] {
            let Step { missed, mistimed, reported } = stepped(by_s, is_numbered);
            assert_eq!((missed, mistimed), (0, 0), "{by_s} s, numbered: {is_numbered}");
            let (sample, told_s) = reported.unwrap();
            assert!(sample <= 3 && (told_s - by_s).abs() < 0.004, "{by_s} s: {told_s} s with sample {sample}");
        }
    }
}

#[test]
fn overtaken_items_are_late_and_cause_no_step() {
    let mut b = ReorderBuffer::new(0.02);
    let unnumbered = |sent_s: f64, arrived_s: f64| timed_item(sent_s + 95.0, arrived_s, None);
    for i in 0..50 {
        b.push(unnumbered(0.01 * f64::from(i), 0.01 * f64::from(i)));
        out(&mut b, 0.01 * f64::from(i));
    }
    // Sent in between, delayed by 0.2 s, and delivered at once.
    for i in 0..10 {
        let taken = b.push(unnumbered(0.305 + 0.01 * f64::from(i), 0.5 + 0.0001 * f64::from(i)));
        assert_eq!(taken, PushOutcome::Late);
    }
    assert_eq!(b.push(unnumbered(0.51, 0.51)), PushOutcome::Waits);
    assert_eq!(b.epoch, 0);
    // The same with sequence numbers.
    let mut b = ReorderBuffer::new(0.02);
    steady(&mut b, 0..200);
    for i in 150..160 {
        assert_eq!(
            b.push(timed_item(0.01 * f64::from(i) + 95.0, 2.0 + 0.01 * f64::from(i - 150), Some(i))),
            PushOutcome::Late
        );
    }
    assert_eq!(b.epoch, 0);
}

#[test]
fn items_dropped_at_a_clock_step_are_counted() {
    // Set forward, with one repeated item.
    let mut b = ReorderBuffer::new(0.02);
    steady(&mut b, 0..200);
    let ahead = |i: u32| timed_item(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
    let taken = [200, 200, 201].map(|i| b.push(ahead(i)))[2];
    assert!(matches!(taken, PushOutcome::Stepped { odd: 2, late: 0, repeated: 1, .. }), "{taken:?}");
    assert_eq!(out(&mut b, 9.0).len(), 2);
}

proptest! {
    /// For any input: times ascend within an epoch, and few items are buffered.
    #[test]
    fn times_ascend(items in prop::collection::vec((0u8..40, any::<bool>(), 0u32..30), 0..400)) {
        let mut b = ReorderBuffer::new(0.02);
        let mut last = (0, f64::NEG_INFINITY);
        for (i, (step, jumps, sequence)) in items.into_iter().enumerate() {
            let now_s = 0.01 * i as f64;
            let time_s = now_s + 0.01 * f64::from(step) + if jumps { 50.0 } else { 0.0 };
            b.push(timed_item(time_s, now_s, (sequence > 3).then_some(sequence)));
            for released in std::iter::from_fn(|| b.pop(now_s)) {
                let next = (released.epoch, released.timed.time_s);
                prop_assert!(next > last, "{next:?} after {last:?}");
                last = next;
            }
            prop_assert!(b.waiting.len() <= 4, "{}", b.waiting.len());
        }
    }
}

#[test]
fn full_buffer_releases_early() {
    let mut b = ReorderBuffer::new(1e9);
    for i in 0..5000 {
        b.push(timed_item(1e-4 * f64::from(i), 1e-4 * f64::from(i), None));
        while b.pop(0.0).is_some() {}
        assert!(b.waiting.len() <= BUFFER_CAPACITY);
    }
    assert_eq!(b.waiting.len(), BUFFER_CAPACITY);
}
