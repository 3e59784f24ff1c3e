//! SMPTE time code of a video's first frame. Source: SMPTE ST 12-1 (drop frame: two numbers a
//! minute are skipped at 29.97 frames a second, four at 59.94, except in every tenth minute).

use std::fmt;

/// Hours, minutes, seconds, frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timecode {
    fields: [u64; 4],
    is_drop_frame: bool,
}

impl Timecode {
    /// Parses `HH:MM:SS:FF`, with `;` before the frames for drop frame. `None` for another form.
    pub fn parse(text: &str) -> Option<Self> {
        let fields: Vec<u64> = text.split([':', ';', '.']).map(|field| field.parse().ok()).collect::<Option<_>>()?;
        let fields: [u64; 4] = fields.try_into().ok()?;
        let is_valid = fields[0] < 24 && fields[1] < 60 && fields[2] < 60 && fields[3] < 120;
        is_valid.then_some(Self { fields, is_drop_frame: text.contains([';', '.']) })
    }

    /// The time code a number of frames later, at a rate in frames per second.
    pub fn advanced(self, frames: usize, fps: f64) -> Self {
        let rate = (fps.round() as u64).clamp(1, 1000);
        // Only at multiples of 29.97 numbers are skipped.
        let is_drop_frame = self.is_drop_frame && rate.is_multiple_of(30);
        let skipped = if is_drop_frame { rate / 15 } else { 0 };
        let [hours, minutes, seconds, frame] = self.fields;
        let minutes = 60 * hours + minutes;
        let per_ten_minutes = 600 * rate - 9 * skipped;
        let count = (60 * minutes + seconds) * rate + frame - skipped * (minutes - minutes / 10) + frames as u64;
        let count = count % (144 * per_ten_minutes);
        // Numbers that were skipped before: in nine minutes of each ten, from their start on.
        let (tens, rest) = (count / per_ten_minutes, count % per_ten_minutes);
        let minutes_of_ten = if rest < 60 * rate { 0 } else { 1 + (rest - 60 * rate) / (60 * rate - skipped) };
        let number = count + skipped * (9 * tens + minutes_of_ten);
        let seconds = number / rate;
        let fields = [seconds / 3600, seconds / 60 % 60, seconds % 60, number % rate];
        Self { fields, is_drop_frame }
    }
}

impl fmt::Display for Timecode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [hours, minutes, seconds, frame] = self.fields;
        let separator = if self.is_drop_frame { ';' } else { ':' };
        write!(f, "{hours:02}:{minutes:02}:{seconds:02}{separator}{frame:02}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_code_advances_by_frames() {
        for (from, frames, fps, to) in [
            ("10:00:00:00", 0, 25.0, "10:00:00:00"),
            ("10:00:00:24", 1, 25.0, "10:00:01:00"),
            ("23:59:59:23", 1, 23.976, "00:00:00:00"),
            // Numbers 0 and 1 of a minute are skipped, except in every tenth.
            ("01:00:59;29", 1, 29.97, "01:01:00;02"),
            ("01:09:59;29", 1, 29.97, "01:10:00;00"),
            ("00:00:00;00", 17_982, 29.97, "00:10:00;00"),
            ("00:00:00;00", 107_892, 29.97, "01:00:00;00"),
            ("00:00:59;59", 1, 59.94, "00:01:00;04"),
            ("00:00:59:29", 1, 29.97, "00:01:00:00"),
            ("10:00:00;00", 1, 25.0, "10:00:00:01"),
        ] {
            let advanced = Timecode::parse(from).unwrap().advanced(frames, fps);
            assert_eq!(advanced.to_string(), to, "{from} + {frames}");
        }
        for text in ["", "10:00:00", "24:00:00:00", "10:60:00:00", "a:0:0:0", "1:2:3:4:5"] {
            assert_eq!(Timecode::parse(text), None, "{text}");
        }
    }
}
