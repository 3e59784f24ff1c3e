//! Numbers and names in messages.

/// A count with its noun, as in "1 sun", "2 suns".
pub fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// Bytes as lowercase hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reason why a file could not be read or written, with advice if there is any.
pub fn reason(error: &std::io::Error) -> String {
    use std::io::ErrorKind;
    let text = match error.kind() {
        ErrorKind::FileTooLarge => "the file size limit is reached (`ulimit -f`); raise it, or write elsewhere",
        ErrorKind::StorageFull => "the disk is full; make room, or write elsewhere",
        ErrorKind::BrokenPipe => "the reader has closed it",
        ErrorKind::NotFound => "there is no such file or folder; check the path",
        ErrorKind::PermissionDenied => "permission denied; check the file's owner and permissions",
        ErrorKind::IsADirectory => "it is a folder; name a file",
        ErrorKind::InvalidData => "it is not text in UTF-8; check that it is the file meant",
        _ => return error.to_string(),
    };
    text.to_owned()
}

/// A unit to follow a number, with a leading space. Empty for pure numbers and text.
pub fn shown_unit(unit: &str) -> String {
    if matches!(unit, "" | "1") { String::new() } else { format!(" {unit}") }
}

/// The shortest text that reads back to the same bits, with an exponent where there would be many
/// zeros: 1e300.
pub fn number(number: f64) -> String {
    if is_plain(number) { number.to_string() } else { format!("{number:e}") }
}

fn is_plain(number: f64) -> bool {
    number == 0.0 || !number.is_finite() || (1e-6..1e16).contains(&number.abs())
}

/// Longest quotation of a foreign word in a message, characters.
const MAX_QUOTED_CHARS: usize = 60;
/// Longest message, characters.
const MAX_SHOWN_CHARS: usize = 2000;

/// Quotes a word from a file in a message. Characters that would move the cursor or begin a line
/// are escaped, and long words are cut.
pub fn quoted(text: &str) -> String {
    cut(text, MAX_QUOTED_CHARS)
}

/// Makes a line safe for a terminal, whatever names and words it contains; see [`quoted`].
pub fn shown(text: &str) -> String {
    cut(text, MAX_SHOWN_CHARS)
}

fn cut(text: &str, max_chars: usize) -> String {
    // Control characters, and those that change the writing direction.
    let is_odd = |c: char| {
        c.is_control() || matches!(c, '\u{200e}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    let mut out = String::new();
    for (i, c) in text.chars().enumerate() {
        if i == max_chars {
            return out + &format!("… ({} bytes in all)", text.len());
        }
        if is_odd(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}

/// A message for the window, without parentheses that name options of the command line, as in
/// " (--force)".
pub fn without_options(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(" (") {
        let (before, from) = rest.split_at(start);
        let Some(end) = from.find(')') else { break };
        let (aside, after) = from.split_at(end + 1);
        out += before;
        if !aside.contains("--") && !aside.contains("`locard ") {
            out += aside;
        }
        rest = after;
    }
    out + rest
}

/// A number with `digits` decimals. Numbers too large to read that way get six significant digits.
pub fn fixed(number: f64, digits: usize) -> String {
    if number.is_finite() && number.abs() >= 1e15 {
        return format!("{number:.5e}");
    }
    let text = format!("{number:.digits$}");
    // Zero has no sign.
    match text.strip_prefix('-').filter(|rest| rest.bytes().all(|b| matches!(b, b'0' | b'.'))) {
        Some(rest) => rest.to_owned(),
        None => text,
    }
}

/// More digits in a row are a number of any size, written without an exponent.
const MAX_DIGITS: usize = 40;

/// A length for a person, in millimetres: whole ones from 10 on.
pub fn millimetres(length_m: f64) -> String {
    let mm = 1e3 * length_m;
    format!("{} mm", fixed(mm, if mm < 9.95 { 1 } else { 0 }))
}

/// A text with its very long numbers in the form of [`number`]: a library quoted them with all
/// their zeros.
pub fn brief(text: &str) -> String {
    let is_digit = |c: char| c.is_ascii_digit() || c == '.';
    let mut out = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(is_digit) {
        let (before, from) = rest.split_at(start);
        let (digits, after) = from.split_at(from.find(|c| !is_digit(c)).unwrap_or(from.len()));
        out += before;
        match digits.parse() {
            Ok(value) if digits.len() > MAX_DIGITS => out += &number(value),
            _ => out += digits,
        }
        rest = after;
    }
    out + rest
}

/// A number with at most six significant digits and no trailing zeros.
pub fn short(number: f64) -> String {
    if !is_plain(number) {
        let text = format!("{number:.5e}");
        let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'));
    }
    let whole_digits = number.abs().max(1e-9).log10().floor() as i32 + 1;
    let rounded = format!("{number:.*}", (6 - whole_digits).clamp(0, 12) as usize);
    match rounded.contains('.') {
        true => rounded.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => rounded,
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn command_line_options_are_omitted() {
        let plain = super::without_options;
        assert_eq!(
            plain("a.png: exists already, and is kept (--force replaces it)"),
            "a.png: exists already, and is kept"
        );
        assert_eq!(plain("a (b) c (`locard inspect SCENE`; --x) d (e"), "a (b) c d (e");
    }

    #[test]
    fn one_is_not_many() {
        assert_eq!([0, 1, 2].map(|n| super::count(n, "sun")), ["0 suns", "1 sun", "2 suns"]);
    }

    #[test]
    fn numbers_read_back_to_the_same_bits() {
        let cases = [
            (0.1, "0.1"),
            (1e300, "1e300"),
            (-2.5e-9, "-2.5e-9"),
            (525.0, "525"),
            (-0.0, "-0"),
            (1e15, "1000000000000000"),
        ];
        for (number, text) in cases {
            assert_eq!(super::number(number), text);
            assert_eq!(text.parse::<f64>().unwrap().to_bits(), number.to_bits());
        }
        let mut bits = 1u64;
        for _ in 0..2000 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let number = f64::from_bits(bits);
            let text = super::number(number);
            assert!(number.is_nan() || text.parse::<f64>().unwrap().to_bits() == bits && text.len() < 26, "{text}");
        }
    }

    #[test]
    fn foreign_text_is_one_short_line() {
        assert_eq!(super::quoted("a\x1b[31m\nb\u{202e}é"), "a\\u{1b}[31m\\nb\\u{202e}é");
        let long = super::quoted(&"x".repeat(100_000_000));
        assert!(long.len() < 100 && long.ends_with("x… (100000000 bytes in all)"), "{long}");
        assert_eq!(super::shown("a plain line: it's \"fine\""), "a plain line: it's \"fine\"");
    }

    #[test]
    fn short_numbers() {
        let cases =
            [(1.0 / 60.0, "0.0166667"), (525.0, "525"), (0.0, "0"), (-0.0004, "-0.0004"), (1234567.0, "1234567")];
        for (number, text) in cases.into_iter().chain([(1e300, "1e300"), (-1.234_567_8e-20, "-1.23457e-20")]) {
            assert_eq!(super::short(number), text);
        }
    }

    #[test]
    fn no_number_fills_the_screen() {
        let cases =
            [(0.1, "0.1"), (-1e300, "-1e300"), (f64::MIN_POSITIVE, "2.2250738585072014e-308"), (4096.0, "4096")];
        for (number, text) in
            cases.into_iter().chain([(f64::INFINITY, "inf"), (9007199254740991.0, "9007199254740991")])
        {
            assert_eq!(super::number(number), text);
        }
        let quoting = |n: f64| super::brief(&format!("floating point `{n}`, 3.25. 10 of {n}"));
        assert_eq!(quoting(1e300), "floating point `1e300`, 3.25. 10 of 1e300");
        assert_eq!(quoting(-0.125), "floating point `-0.125`, 3.25. 10 of -0.125");
        assert_eq!([1e300, -0.25, -0.04].map(|n| super::fixed(n, 1)), ["1.00000e300", "-0.2", "0.0"]);
    }
}
