//! Stop series of cameras: f-numbers, shutter times, film speeds.
//!
//! Every stop has two numbers: the engraved one (f/5.6, 1/125 s) and the exact one (√32, 2^-7 s).
//! Full stops double or halve the light; there are three third stops to a full one. The marked
//! numbers are the usual ones; the exact ones are f = √2^n, t = 2^-n s and ISO 100·2^n.

use std::str::FromStr;

/// One stop of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The engraved number, also used in EXIF.
    pub marked: f64,
    /// The exact number, for computations.
    pub exact: f64,
}

/// Spacing of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    Full,
    Third,
}

/// f/0.7 to f/64 in thirds. The full stops are every third one, starting with the first.
const F_NUMBERS: [f64; 40] = [
    0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.2, 3.5, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0,
    10.0, 11.0, 13.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 29.0, 32.0, 36.0, 40.0, 45.0, 51.0, 57.0, 64.0,
];
/// 30 s to 0.3 s in thirds, then fractions of a second: 1/4 to 1/8000.
const SECONDS: [f64; 21] =
    [30.0, 25.0, 20.0, 15.0, 13.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3];
const PARTS_OF_A_SECOND: [f64; 34] = [
    4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 125.0, 160.0, 200.0, 250.0,
    320.0, 400.0, 500.0, 640.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0, 3200.0, 4000.0, 5000.0, 6400.0, 8000.0,
];
/// ISO 100 to 25600 in thirds.
const ISO_SPEEDS: [f64; 25] = [
    100.0, 125.0, 160.0, 200.0, 250.0, 320.0, 400.0, 500.0, 640.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0,
    3200.0, 4000.0, 5000.0, 6400.0, 8000.0, 10000.0, 12800.0, 16000.0, 20000.0, 25600.0,
];

/// Text that is not a camera setting.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StopError {
    #[error("expected an f-number from 0.5 to 256, as in 2.8 or f/2.8")]
    Aperture,
    #[error("expected more than 0 and up to 60 s, as in 1/60, 1/60s, 0.5 or 2s (from 1/1000000)")]
    Shutter,
    #[error("expected ISO 100 to 25600, as in 400 or ISO400")]
    Iso,
}

fn series(step: Step, marked: impl Iterator<Item = f64>, exact: impl Fn(f64) -> f64) -> Vec<Stop> {
    let every = if step == Step::Full { 3 } else { 1 };
    let thirds = marked.enumerate().map(|(i, marked)| Stop { marked, exact: exact(i as f64 / 3.0) });
    thirds.step_by(every).collect()
}

/// f/0.7 to f/64, ascending: each full stop is √2 times the one before, and half the light.
pub fn f_numbers(step: Step) -> Vec<Stop> {
    // The first, 0.7, is √2^-1.
    series(step, F_NUMBERS.into_iter(), |stops| (0.5 * (stops - 1.0)).exp2())
}

/// 30 s to 1/8000 s, descending, seconds: each full stop is half the one before.
pub fn shutter_times_s(step: Step) -> Vec<Stop> {
    let marked = SECONDS.into_iter().chain(PARTS_OF_A_SECOND.into_iter().map(|part| 1.0 / part));
    // The first, 30, is 2^5.
    series(step, marked, |stops| (5.0 - stops).exp2())
}

/// ISO 100 to 25600, ascending: each full stop is twice the one before.
pub fn iso_speeds(step: Step) -> Vec<Stop> {
    series(step, ISO_SPEEDS.into_iter(), |stops| 100.0 * stops.exp2())
}

/// The nearest stop to a value, by ratio. `None` for an empty series or a value that is not above
/// 0.
pub fn nearest(series: &[Stop], value: f64) -> Option<Stop> {
    let value = Some(value).filter(|v| v.is_finite() && *v > 0.0)?;
    let log_distance = |stop: &Stop| (stop.exact / value).ln().abs();
    series.iter().copied().min_by(|a, b| log_distance(a).total_cmp(&log_distance(b)))
}

/// The exact value of an engraved number: √32 for 5.6. Numbers that are no stop are returned
/// unchanged.
pub fn exact(series: &[Stop], value: f64) -> f64 {
    series.iter().find(|stop| same(stop.marked, value)).map_or(value, |stop| stop.exact)
}

/// The engraved number of an exact value: 5.6 for √32. Values between stops are returned unchanged.
pub fn marked(series: &[Stop], value: f64) -> f64 {
    series.iter().find(|stop| same(stop.exact, value)).map_or(value, |stop| stop.marked)
}

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs()
}

/// Parses "2.8", "f/2.8" or "F2.8".
pub fn parse_f_number(text: &str) -> Result<f64, StopError> {
    let plain = text.trim().trim_start_matches(['f', 'F']).trim_start_matches('/');
    let value = f64::from_str(plain.trim()).ok().filter(|v| (0.5..=256.0).contains(v));
    value.ok_or(StopError::Aperture)
}

/// Parses "1/60", "1/60s", "0.5", "2s" or "2\"", seconds.
pub fn parse_shutter_s(text: &str) -> Result<f64, StopError> {
    let plain = text.trim().trim_end_matches(['s', '"']).trim_end();
    let number = |t: &str| f64::from_str(t.trim()).ok();
    let value = match plain.split_once('/') {
        Some((over, under)) => number(over).zip(number(under)).map(|(over, under)| over / under),
        None => number(plain),
    };
    value.filter(|v| (1e-6..=60.0).contains(v)).ok_or(StopError::Shutter)
}

/// Parses "400" or "ISO 400".
pub fn parse_iso(text: &str) -> Result<f64, StopError> {
    let plain = text.trim();
    let plain = plain.get(..3).filter(|start| start.eq_ignore_ascii_case("iso")).map_or(plain, |_| &plain[3..]);
    let value = f64::from_str(plain.trim()).ok().filter(|v| (100.0..=25600.0).contains(v));
    value.ok_or(StopError::Iso)
}

/// "f/5.6", for 5.6 and for √32.
pub fn format_f_number(f_number: f64) -> String {
    format!("f/{}", trimmed(marked(&f_numbers(Step::Third), f_number)))
}

/// "1/125 s" for 1/125 and 2^-7, "2 s", "0.3 s".
pub fn format_shutter_s(time_s: f64) -> String {
    let time_s = marked(&shutter_times_s(Step::Third), time_s);
    // Cameras show fractions of a second from 1/4 on.
    let part = 1.0 / time_s;
    if time_s > 0.0 && time_s < 0.29 { format!("1/{} s", trimmed(part)) } else { format!("{} s", trimmed(time_s)) }
}

/// "ISO 400".
pub fn format_iso(iso: f64) -> String {
    format!("ISO {}", trimmed(marked(&iso_speeds(Step::Third), iso)))
}

/// Three significant digits, without decimals from 100 on.
fn trimmed(value: f64) -> String {
    if value >= 99.95 {
        return format!("{value:.0}");
    }
    let text = format!("{value:.*}", if value >= 9.995 { 1 } else { 2 });
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn marks(series: &[Stop]) -> Vec<f64> {
        series.iter().map(|s| s.marked).collect()
    }

    #[test]
    fn full_stops_are_the_usual_series() {
        let series = f_numbers(Step::Full);
        assert_eq!(marks(&series), [0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 32.0, 45.0, 64.0]);
        let five_six = series[6];
        assert!((five_six.exact - 32f64.sqrt()).abs() < 1e-12);
        // The series of the paper: 1/15, 1/30, 1/60, 1/125, 1/250.
        let series = shutter_times_s(Step::Full);
        let parts: Vec<_> = series.iter().map(|s| format_shutter_s(s.marked)).collect();
        assert_eq!(
            parts,
            [
                "30 s", "15 s", "8 s", "4 s", "2 s", "1 s", "0.5 s", "1/4 s", "1/8 s", "1/15 s", "1/30 s", "1/60 s",
                "1/125 s", "1/250 s", "1/500 s", "1/1000 s", "1/2000 s", "1/4000 s", "1/8000 s"
            ]
        );
        assert_eq!(series[12].exact, 2f64.powi(-7));
        assert_eq!(
            marks(&iso_speeds(Step::Full)),
            [100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0, 12800.0, 25600.0]
        );
    }

    #[test]
    fn marked_numbers_are_close_to_exact_ones() {
        for (series, per_click) in [
            (f_numbers(Step::Third), 2f64.powf(1.0 / 6.0)),
            (shutter_times_s(Step::Third), 2f64.powf(-1.0 / 3.0)),
            (iso_speeds(Step::Third), 2f64.powf(1.0 / 3.0)),
        ] {
            for pair in series.windows(2) {
                assert!((pair[1].exact / pair[0].exact - per_click).abs() < 1e-12);
                assert!((pair[1].marked > pair[0].marked) == (per_click > 1.0));
            }
            // Marked numbers are at most 7 % off: 1/15, 1/30 and 1/60 s by 6.7 %, f/1.2 by 4.8 %.
            for stop in &series {
                assert!((stop.marked / stop.exact - 1.0).abs() < 0.07, "{stop:?}");
                assert_eq!(nearest(&series, stop.marked), Some(*stop));
            }
        }
        assert_eq!((f_numbers(Step::Third).len(), shutter_times_s(Step::Third).len()), (40, 55));
    }

    #[test]
    fn nearest_exact_and_marked() {
        let series = f_numbers(Step::Full);
        assert_eq!(nearest(&series, 4.8).unwrap().marked, 5.6);
        assert_eq!(nearest(&series, 4.7).unwrap().marked, 4.0);
        assert_eq!(nearest(&series, 1e9).unwrap().marked, 64.0);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(nearest(&series, bad), None);
        }
        assert!((exact(&series, 5.6) - 32f64.sqrt()).abs() < 1e-12);
        assert_eq!((exact(&series, 5.5), marked(&series, 5.5)), (5.5, 5.5));
        assert_eq!(marked(&series, 32f64.sqrt()), 5.6);
        assert_eq!(marked(&shutter_times_s(Step::Full), 2f64.powi(-7)), 1.0 / 125.0);
    }

    #[test]
    fn stop_texts_are_parsed() {
        for (text, value) in [("2.8", 2.8), ("f/2.8", 2.8), ("F2.8", 2.8), (" f/ 16 ", 16.0), ("0.5", 0.5)] {
            assert_eq!(parse_f_number(text), Ok(value), "{text}");
        }
        for (text, value) in [
            ("1/60", 1.0 / 60.0),
            ("1/60s", 1.0 / 60.0),
            ("1 / 60 s", 1.0 / 60.0),
            ("2s", 2.0),
            ("2\"", 2.0),
            ("0.5", 0.5),
        ] {
            assert_eq!(parse_shutter_s(text), Ok(value), "{text}");
        }
        for (text, value) in [("400", 400.0), ("ISO 400", 400.0), ("iso25600", 25600.0)] {
            assert_eq!(parse_iso(text), Ok(value), "{text}");
        }
    }

    #[test]
    fn impossible_stops_are_refused_with_the_accepted_range() {
        for text in ["0", "-2.8", "", "f/", "f/0", "nan", "inf", "300", "wide", "2,8"] {
            assert!(parse_f_number(text).unwrap_err().to_string().contains("0.5 to 256"), "{text}");
        }
        for text in ["0", "0s", "1/0", "0/60", "-1/60", "", "s", "61", "1/60/2", "nan", "inf", "1/1e9", "auto"] {
            let error = parse_shutter_s(text).unwrap_err().to_string();
            assert!(error.contains("more than 0 and up to 60 s"), "{error}");
        }
        for text in ["99", "25601", "0", "-400", "ISO", "", "nan", "is€"] {
            assert!(parse_iso(text).unwrap_err().to_string().contains("ISO 100 to 25600"), "{text}");
        }
    }

    #[test]
    fn stops_are_formatted_as_on_a_camera() {
        for (value, text) in [(32f64.sqrt(), "f/5.6"), (5.6, "f/5.6"), (11.0, "f/11"), (4.8, "f/4.8"), (1.0, "f/1")] {
            assert_eq!(format_f_number(value), text);
        }
        for (value, text) in [
            (2f64.powi(-7), "1/125 s"),
            (0.02, "1/50 s"),
            (2.0, "2 s"),
            (0.3, "0.3 s"),
            (0.25, "1/4 s"),
            (1.0 / 90.0, "1/90 s"),
            (0.0, "0 s"),
        ] {
            assert_eq!(format_shutter_s(value), text);
        }
        assert_eq!(format_iso(100.0 * 2f64.powf(5.0 / 3.0)), "ISO 320");
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC{0,12}") {
            let _ = (parse_f_number(&text), parse_shutter_s(&text), parse_iso(&text));
        }

        #[test]
        fn formatted_stop_parses_back(i in 0usize..55) {
            let stop = shutter_times_s(Step::Third)[i];
            if stop.marked <= 60.0 {
                prop_assert!((parse_shutter_s(&format_shutter_s(stop.exact)).unwrap() / stop.marked - 1.0).abs() < 1e-9);
            }
        }
    }
}
