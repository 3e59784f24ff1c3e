//! Amounts of transforms: parsing of typed text, and formatting.

use super::super::fields::parse_number;
use locard_engine::text::number;

/// Quantity of an amount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Metres; `cm` and `mm` are accepted.
    Length,
    /// Degrees.
    Angle,
    /// A factor; per cent is accepted.
    Factor,
}

/// A number while it is typed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TypedAmount(String);

const MAX_TYPED_BYTES: usize = 16;
/// Characters of the units: metres and their parts, per cent, degrees.
const UNITS: [char; 4] = ['c', 'm', '%', '°'];

impl TypedAmount {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn text(&self) -> &str {
        &self.0
    }

    /// Appends a character of a number or its unit, and ignores others. A minus toggles the sign at
    /// any position.
    pub fn push(&mut self, c: char) {
        match c {
            '-' | '−' => match self.0.strip_prefix('-') {
                Some(rest) => self.0 = rest.to_owned(),
                None => self.0.insert(0, '-'),
            },
            '0'..='9' | '.' | ',' | '/' if self.0.len() < MAX_TYPED_BYTES && !self.0.ends_with(UNITS) => self.0.push(c),
            // A unit follows a digit.
            c if UNITS.contains(&c) && self.0.ends_with(|c: char| c.is_ascii_digit() || UNITS[..2].contains(&c)) => {
                self.0.push(c);
            }
            _ => {}
        }
    }

    /// Removes the last character.
    pub fn pop(&mut self) {
        self.0.pop();
    }

    /// Metres, degrees or a factor. `None` if the text is not a number.
    pub fn value(&self, unit: Unit) -> Option<f64> {
        let digits = self.0.trim_end_matches(UNITS);
        let number = parse_number(digits)?;
        match (unit, &self.0[digits.len()..]) {
            (_, "") | (Unit::Length, "m") | (Unit::Angle, "°") => Some(number),
            // Not times 0.01, which has no exact binary representation.
            (Unit::Length, "cm") | (Unit::Factor, "%") => Some(number / 100.0),
            (Unit::Length, "mm") => Some(number / 1000.0),
            _ => None,
        }
    }
}

/// A length to a tenth of a millimetre, in centimetres below 1 m: `3.2 cm`, `1.25 m`.
pub fn length(metres: f64) -> String {
    // Adding 0.0 turns −0 into 0.
    let rounded = |n: f64| number((n * 100.0).round() / 100.0 + 0.0);
    match metres.abs() {
        long if long >= 0.99995 => format!("{} m", number((metres * 1e4).round() / 1e4)),
        _ => format!("{} cm", rounded(metres * 100.0)),
    }
}

/// An angle to a tenth of a degree.
pub fn angle(degrees: f64) -> String {
    format!("{}°", number((degrees * 10.0).round() / 10.0 + 0.0))
}

/// A factor in per cent: `120 %`.
pub fn factor(factor: f64) -> String {
    format!("{} %", number((factor * 1000.0).round() / 10.0 + 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(text: &str) -> TypedAmount {
        let mut typed = TypedAmount::default();
        text.chars().for_each(|c| typed.push(c));
        typed
    }

    #[test]
    fn typed_number_with_either_decimal_mark_and_a_unit_is_parsed() {
        let metres = |text: &str| typed(text).value(Unit::Length);
        assert_eq!([metres("0,1"), metres("0.1"), metres("10cm"), metres("100mm"), metres("1/10m")], [Some(0.1); 5]);
        // A minus at any position; two cancel.
        assert_eq!([metres("-3"), metres("3-"), metres("-3-")], [Some(-3.0), Some(-3.0), Some(3.0)]);
        assert_eq!([metres(""), metres("-"), metres(","), metres("5%"), metres("5c")], [None; 5]);
        assert_eq!((typed("45°").value(Unit::Angle), typed("45cm").value(Unit::Angle)), (Some(45.0), None));
        assert_eq!((typed("1,2").value(Unit::Factor), typed("120%").value(Unit::Factor)), (Some(1.2), Some(1.2)));
        // Other letters are ignored.
        assert_eq!(typed("x1g z2cm3").text(), "12cm");
        let mut one = typed("12");
        one.pop();
        assert_eq!(one.value(Unit::Length), Some(1.0));
        assert!(typed(&"9".repeat(99)).text().len() == MAX_TYPED_BYTES);
    }

    #[test]
    fn amounts_are_formatted_with_the_unit_of_their_magnitude() {
        assert_eq!([0.032, 0.1 + 0.2, -0.00004, 0.00024].map(length), ["3.2 cm", "30 cm", "0 cm", "0.02 cm"]);
        assert_eq!([1.25, -2.0, 0.99999].map(length), ["1.25 m", "-2 m", "1 m"]);
        assert_eq!((angle(44.96), factor(1.2), factor(0.333)), ("45°".into(), "120 %".into(), "33.3 %".into()));
    }
}
