//! Subtitles in which DJI's cameras write their settings, several times a second or once. The
//! wording differs by model: `[shutter : 1/80.0] [fnum : 280]`, `ISO:100 Shutter:60 Fnum:2.2`,
//! `F/3.5, SS 1000, ISO 100`.

use super::setting::Setting;
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::frame::PhotoSettings;

/// A cue's last setting, before its end, s: the resolution of subtitles' times.
const BEFORE_END_S: f64 = 0.001;
/// Older cameras write f/2.8 as 2.8, newer ones as 280.
const MIN_HUNDREDTHS: f64 = 100.0;

/// The settings at each cue's start and end. A cue that states no exposure time or no film speed is
/// passed over.
pub fn settings(text: &str) -> Vec<Setting> {
    let text = text.replace('\r', "");
    let cue = |block: &str| {
        let (start_s, end_s) = block.lines().find_map(times)?;
        let photo = photo(block)?;
        let end_s = (end_s - BEFORE_END_S).max(start_s);
        Some([Setting { at_s: start_s, photo }, Setting { at_s: end_s, photo }])
    };
    text.split("\n\n").filter_map(cue).flatten().collect()
}

/// `00:00:01,034 --> 00:00:01,067` in seconds.
fn times(line: &str) -> Option<(f64, f64)> {
    let (start, end) = line.split_once("-->")?;
    Some((seconds(start)?, seconds(end)?))
}

fn seconds(text: &str) -> Option<f64> {
    let text = text.trim().replace(',', ".");
    let mut parts = text.split(':').map(|part| part.parse::<f64>().ok());
    let [hours, minutes, seconds] = [parts.next()??, parts.next()??, parts.next()??];
    let time_s = 3600.0 * hours + 60.0 * minutes + seconds;
    (time_s.is_finite() && time_s >= 0.0 && parts.next().is_none()).then_some(time_s)
}

fn photo(cue: &str) -> Option<PhotoSettings> {
    let cue = cue.to_ascii_lowercase();
    let positive = |text: &str| text.parse::<f64>().ok().filter(|value| *value > 0.0);
    // `1/80.0`, or the denominator alone.
    let time = value(&cue, &["shutter", "ss"])?;
    let time_s = match time.split_once('/') {
        Some((above, below)) => positive(above)? / positive(below)?,
        None => 1.0 / positive(time)?,
    };
    let iso = positive(value(&cue, &["iso"])?)?;
    let f_number = value(&cue, &["fnum", "f/"]).and_then(positive);
    let f_number = f_number.map(|number| if number >= MIN_HUNDREDTHS { number / 100.0 } else { number });
    let time_s = Some(time_s).filter(|time_s| *time_s <= MAX_EXPOSURE_S);
    Some(PhotoSettings { time_s, f_number, iso: Some(iso), ..PhotoSettings::default() })
}

/// The number or fraction that follows one of the keys, after spaces and a colon.
fn value<'a>(text: &'a str, keys: &[&str]) -> Option<&'a str> {
    keys.iter().find_map(|key| {
        text.match_indices(key).find_map(|(at, _)| {
            let is_word = !text[..at].ends_with(|c: char| c.is_ascii_alphanumeric());
            let rest = text[at + key.len()..].trim_start_matches([' ', ':']);
            let length = rest.find(|c: char| !c.is_ascii_digit() && c != '.' && c != '/').unwrap_or(rest.len());
            (is_word && length > 0).then_some(&rest[..length])
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cue(times: &str, text: &str) -> String {
        format!("7\r\n{times}\r\n{text}\r\n\r\n")
    }

    #[test]
    fn wordings_of_several_models_are_read() {
        let newer = "<font size=\"36\">SrtCnt : 7, DiffTime : 33ms\n2026-08-07 13:40:40,975,000\n\
                     [iso : 110] [shutter : 1/80.0] [fnum : 280] [ev : 0] [ct : 5748] [focal_len : 240] </font>";
        let older = "HOME(8.5,47.3) 2026.07.29 15:18:50\nISO:100 Shutter:60 EV: Fnum:2.2 ";
        let other = "F/3.5, SS 1000, ISO 400, EV 0, GPS (8.6, 47.1, 18), D 24.26m, H 6.00m, H.S 2.10m/s";
        for (text, f_number, time_s, iso) in
            [(newer, 2.8, 1.0 / 80.0, 110.0), (older, 2.2, 1.0 / 60.0, 100.0), (other, 3.5, 0.001, 400.0)]
        {
            let settings = settings(&cue("00:01:00,200 --> 00:01:00,234", text));
            let photo = PhotoSettings {
                f_number: Some(f_number),
                time_s: Some(time_s),
                iso: Some(iso),
                ..PhotoSettings::default()
            };
            assert_eq!(settings.iter().map(|setting| setting.photo).collect::<Vec<_>>(), [photo; 2], "{text}");
            let times_s = [settings[0].at_s, settings[1].at_s];
            assert!((times_s[0] - 60.2).abs() < 1e-9 && (times_s[1] - 60.233).abs() < 1e-9, "{times_s:?}");
        }
    }

    #[test]
    fn subtitles_without_settings_have_none() {
        let speech = "Where is the miso? In the shutter of 1950.\nF/A-18";
        let text = cue("00:00:00,000 --> 00:00:01,000", speech)
            + &cue("00:00:01,000 --> 00:00:02,000", "GPS(8.5,47.3,0.0M) BAROMETER:0.3M")
            + &cue("no time", "ISO:100 Shutter:60")
            + &cue("00:00:03,000 --> 00:00:04,000", "ISO:100 Shutter:0");
        assert_eq!(settings(&text), []);
    }

    proptest! {
        #[test]
        fn any_text_never_panics(text in "([0-9]{1,2}:){2}[0-9],[0-9] --> [0-9:,]{0,9}\n(iso|shutter|ss|f/|fnum|[ :./0-9é]){0,9}") {
            let _ = settings(&text);
        }
    }
}
