//! Parameters, declared once.
//!
//! [`params!`](crate::params!) takes a name, a default, a unit, a range and one line of help. The
//! struct, its TOML table, `--set table.name=value` and `locard params` come from that one
//! declaration. Parameters are listed nowhere else.

mod declare;

use std::collections::BTreeMap;
use std::fmt;

use crate::stage::Stage;
use crate::text::{number, quoted};

/// A parameter's value between text and field. Files spell out the word `none`, because some
/// formats cannot store a missing value.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// Not given. Only if [`Spec::optional`].
    #[serde(serialize_with = "write_none", deserialize_with = "read_none")]
    None,
    Bool(bool),
    Number(f64),
    Text(String),
}

fn write_none<S: serde::Serializer>(to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str("none")
}

fn read_none<'de, D: serde::Deserializer<'de>>(from: D) -> Result<(), D::Error> {
    match <String as serde::Deserialize>::deserialize(from)?.as_str() {
        "none" => Ok(()),
        other => Err(serde::de::Error::custom(format!("{other} is not none"))),
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "none"),
            Self::Bool(b) => write!(f, "{b}"),
            Self::Number(n) => f.write_str(&number(*n)),
            Self::Text(t) => f.write_str(&quoted(t)),
        }
    }
}

impl Value {
    /// Parses the text after `--set table.name=`.
    pub fn parse(text: &str) -> Self {
        match text.trim() {
            "none" => Self::None,
            "true" | "on" => Self::Bool(true),
            "false" | "off" => Self::Bool(false),
            other => other.parse().map_or_else(|_| Self::Text(other.to_owned()), Self::Number),
        }
    }
}

/// The values that a parameter accepts.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    Bool,
    /// Any finite number in the closed range.
    Number {
        min: f64,
        max: f64,
    },
    /// A whole number in the closed range.
    Integer {
        min: f64,
        max: f64,
    },
    Choice(&'static [&'static str]),
    /// Pairs of numbers that ascend.
    Points,
    /// A lens as a table.
    LensTable,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool => write!(f, "true or false"),
            Self::Number { min, max } => write!(f, "a number from {} to {}", number(*min), number(*max)),
            Self::Integer { min, max } => {
                write!(f, "a whole number from {} to {}", number(*min), number(*max))
            }
            Self::Choice(names) => write!(f, "{}", names.join(" | ")),
            Self::Points => write!(f, "pairs that ascend from code 0 to 1, such as 0 0, 0.5 0.2, 1 1"),
            Self::LensTable => write!(f, "a lens's table; a profile names ST maps in its place"),
        }
    }
}

/// The declaration of one parameter.
#[derive(Clone, Debug)]
pub struct Spec {
    pub name: &'static str,
    /// Displayed name, if the key alone reads badly; see [`Spec::words`].
    pub called: Option<&'static str>,
    /// Empty for switches and choices.
    pub unit: &'static str,
    pub kind: Kind,
    pub default: Value,
    /// Whether `none` is accepted.
    pub optional: bool,
    pub help: &'static str,
    /// Whether it is felt by its ratio: a slider of it goes by decades.
    pub by_ratio: bool,
    /// When it does something at all; `None`: always.
    pub acts_if: Option<ActsIf>,
    /// The first stage of a frame that reads it. A change recomputes this stage and those that read
    /// its result; all of them if it changes how far an effect reaches. `None` for parameters that
    /// are not a frame's.
    pub stage: Option<Stage>,
}

/// Condition under which a parameter has an effect: another parameter of its table has, or lacks, a
/// value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActsIf {
    pub other: &'static str,
    /// It must have the value, or else any other one.
    pub is: bool,
    /// The value as it is typed, or several: `a or b`.
    pub value: &'static str,
}

impl ActsIf {
    /// The values as they are typed.
    pub fn values(&self) -> impl Iterator<Item = &'static str> {
        self.value.split(" or ")
    }
}

impl fmt::Display for ActsIf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { other, is, value } = self;
        write!(f, "only where {other} {} {value}", if *is { "is" } else { "is not" })
    }
}

/// Suffixes of names that denote a unit.
const UNITS: [(&str, &str); 7] =
    [("px", "_px"), ("s", "_s"), ("m", "_m"), ("mm", "_mm"), ("deg", "_deg"), ("EV", "_ev"), ("1/s", "_per_s")];

impl Spec {
    /// The name as a person reads it: as it is declared, or else its words, without the unit, which
    /// stands with the value.
    pub fn words(&self) -> String {
        let end = UNITS.iter().find(|(unit, _)| *unit == self.unit).map_or("", |(_, end)| end);
        let stem = self.name.strip_suffix(end).filter(|stem| !stem.is_empty()).unwrap_or(self.name);
        self.called.map_or_else(|| sentence(&stem.replace('_', " ")), str::to_owned)
    }

    /// Why it does nothing now in its table, if another parameter makes it idle.
    pub fn idle(&self, params: &dyn Params) -> Option<String> {
        let acts_if = self.acts_if?;
        let other = params.specs().into_iter().find(|spec| spec.name == acts_if.other)?;
        // A parameter that depends on an idle one is idle itself.
        if let Some(why) = other.idle(params) {
            return Some(why);
        }
        // The name of a choice may equal a switch's value elsewhere.
        let (now, value) = (params.get(acts_if.other)?, acts_if.value);
        if acts_if.values().any(|value| now == Value::parse(value) || now == Value::Text(value.to_owned()))
            == acts_if.is
        {
            return None;
        }
        let is = if acts_if.is { "is" } else { "is not" };
        let value = match (&other.kind, value) {
            (Kind::Bool, "true") => "on",
            (Kind::Bool, "false") => "off",
            _ => value,
        };
        Some(format!("only where “{}” {is} {value}", other.words()))
    }
}

/// A table's name as a person reads it: `camera.lens` is "Camera: lens".
pub fn title(table: &str) -> String {
    sentence(&table.replace('_', " ").replace('.', ": "))
}

/// A parameter as a person reads it, with its table: "Camera: lens: focus distance" is
/// `camera.lens.focus_distance_m`.
pub fn called(params: &dyn Params, name: &str) -> String {
    let spec = params.specs().into_iter().find(|spec| spec.name == name);
    format!("{}: {}", title(params.table()), spec.map_or_else(|| name.to_owned(), |spec| spec.words()))
}

/// Beginning with a capital.
fn sentence(words: &str) -> String {
    let mut chars = words.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// Why a value was refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum ParamError {
    #[error("there is no parameter {table}.{name}; {table} has: {names}")]
    UnknownName { table: String, name: String, names: String },
    #[error("{table}.{name} = {actual}: expected {accepted}{unit}")]
    Refused { table: String, name: String, actual: String, accepted: String, unit: String },
}

/// A table of parameters: reads and writes its fields by name.
pub trait Params {
    /// The TOML table's name: the part of `--set` before the last dot.
    fn table(&self) -> &'static str;
    /// The first stage of a frame that reads its parameters, except those that declare their own.
    fn table_stage(&self) -> Option<Stage>;
    fn specs(&self) -> Vec<Spec>;
    /// `None` if there is no such name.
    fn get(&self, name: &str) -> Option<Value>;
    /// Checks the range. On an error nothing changes.
    fn set(&mut self, name: &str, value: &Value) -> Result<(), ParamError>;
}

/// Every parameter's value, by name.
pub fn values(params: &dyn Params) -> BTreeMap<String, Value> {
    let value = |spec: Spec| Some((spec.name.to_owned(), params.get(spec.name)?));
    params.specs().into_iter().filter_map(value).collect()
}

/// A table with these values, and defaults for the rest.
pub fn of_values<P: Params + Default>(values: BTreeMap<String, Value>) -> Result<P, ParamError> {
    let mut params = P::default();
    values.iter().try_for_each(|(name, value)| params.set(name, value))?;
    Ok(params)
}

#[doc(hidden)]
pub fn unknown_name(table: &str, name: &str, specs: &[Spec]) -> ParamError {
    let names = specs.iter().map(|s| s.name).collect::<Vec<_>>().join(", ");
    ParamError::UnknownName { table: table.to_owned(), name: name.to_owned(), names }
}

#[doc(hidden)]
pub fn refused(table: &str, spec: &Spec, value: &Value) -> ParamError {
    let unit = if matches!(spec.unit, "" | "1") { String::new() } else { format!(" ({})", spec.unit) };
    let accepted = if spec.optional { format!("{} or none", spec.kind) } else { spec.kind.to_string() };
    ParamError::Refused {
        table: table.to_owned(),
        name: spec.name.to_owned(),
        actual: value.to_string(),
        accepted,
        unit,
    }
}

/// A type that a parameter may have. Used by [`params!`](crate::params!).
pub trait Field: Sized {
    const OPTIONAL: bool = false;
    fn kind(range: Option<(f64, f64)>) -> Kind;
    fn to_value(&self) -> Value;
    /// `None` if `kind` does not accept the value.
    fn from_value(value: &Value, kind: &Kind) -> Option<Self>;
}

fn number_in(value: &Value, kind: &Kind) -> Option<f64> {
    match (value, kind) {
        (Value::Number(n), Kind::Number { min, max }) if n.is_finite() && n >= min && n <= max => Some(*n),
        (Value::Number(n), Kind::Integer { min, max }) if n.fract() == 0.0 && n >= min && n <= max => Some(*n),
        _ => None,
    }
}

impl Field for bool {
    fn kind(_: Option<(f64, f64)>) -> Kind {
        Kind::Bool
    }
    fn to_value(&self) -> Value {
        Value::Bool(*self)
    }
    fn from_value(value: &Value, _: &Kind) -> Option<Self> {
        match value {
            Value::Bool(b) => Some(*b),
            _ => None,
        }
    }
}

macro_rules! number_field {
    ($type:ty, $kind:ident) => {
        impl Field for $type {
            fn kind(range: Option<(f64, f64)>) -> Kind {
                let (min, max) = range.unwrap_or((f64::MIN, f64::MAX));
                Kind::$kind { min, max }
            }
            fn to_value(&self) -> Value {
                // Through its shortest text: 0.02 stays 0.02 when it is widened from 32 to 64 bits.
                Value::Number(self.to_string().parse().unwrap_or(f64::NAN))
            }
            fn from_value(value: &Value, kind: &Kind) -> Option<Self> {
                number_in(value, kind).map(|n| n as $type)
            }
        }
    };
}
number_field!(f32, Number);
number_field!(f64, Number);
number_field!(u32, Integer);
number_field!(u64, Integer);

impl<T: Field> Field for Option<T> {
    const OPTIONAL: bool = true;
    fn kind(range: Option<(f64, f64)>) -> Kind {
        T::kind(range)
    }
    fn to_value(&self) -> Value {
        self.as_ref().map_or(Value::None, Field::to_value)
    }
    fn from_value(value: &Value, kind: &Kind) -> Option<Self> {
        match value {
            Value::None => Some(None),
            other => T::from_value(other, kind).map(Some),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::choices! {
        /// Test.
        pub enum Method { Fast = "fast", Good = "good", Off = "off", Two = "2" }
    }
    crate::params! {
        /// Test.
        pub struct Demo in "demo" {
            "how much" amount as "How much": f32 = 0.5, "px", 0.0..=2.0;
            "how many" count: u32 = 3, "1", 1.0..=9.0;
            "which way" method: Method = Method::Good;
            "maybe" maybe: Option<f64> = None, "s", 0.0..=1.0, by_ratio => method isnt "off";
            "how good" grade: u32 = 1, "1", 1.0..=9.0 => method is "good";
            "how good beyond that" more: u32 = 1, "1", 1.0..=9.0 => grade isnt "2";
        }
    }

    #[test]
    fn sets_by_name_and_refuses_with_the_range() {
        let mut demo = Demo::default();
        demo.set("amount", &Value::parse("1.5")).unwrap();
        demo.set("method", &Value::parse("fast")).unwrap();
        demo.set("maybe", &Value::parse("0.25")).unwrap();
        assert_eq!(demo, Demo { amount: 1.5, count: 3, method: Method::Fast, maybe: Some(0.25), grade: 1, more: 1 });
        let error = demo.set("amount", &Value::Number(2.5)).unwrap_err().to_string();
        assert_eq!(error, "demo.amount = 2.5: expected a number from 0 to 2 (px)");
        assert!(demo.set("count", &Value::Number(1.5)).is_err());
        assert!(demo.set("amount", &Value::Number(f64::NAN)).is_err());
        assert!(demo.set("amount", &Value::None).is_err());
        let error = demo.set("amont", &Value::Number(1.0)).unwrap_err().to_string();
        assert!(error.contains("amount, count, method, maybe, grade"), "{error}");
        assert_eq!(demo.amount, 1.5);
    }

    #[test]
    fn choice_names_are_not_read_as_switches_or_numbers() {
        let mut demo = Demo::default();
        for (text, method) in [("off", Method::Off), ("2", Method::Two), ("fast", Method::Fast)] {
            demo.set("method", &Value::parse(text)).unwrap();
            assert_eq!(demo.method, method);
            demo.set("method", &Value::Text(text.to_owned())).unwrap();
            assert_eq!((demo.method, demo.get("method")), (method, Some(Value::Text(text.to_owned()))));
        }
        for wrong in ["on", "3", "none", "slow"] {
            assert!(demo.set("method", &Value::parse(wrong)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn names_are_read_as_words_without_their_unit() {
        let spec = |name, unit, called| Spec { name, unit, called, ..Demo::default().specs()[0].clone() };
        for (name, unit, words) in [
            ("focus_distance_m", "m", "Focus distance"),
            ("frames_per_s", "1/s", "Frames"),
            ("iso", "1", "Iso"),
            ("ev", "EV", "Ev"),
            ("threshold_px", "mm", "Threshold px"),
        ] {
            assert_eq!(spec(name, unit, None).words(), words);
        }
        assert_eq!(spec("iso", "1", Some("ISO")).words(), "ISO");
        let demo = Demo::default();
        assert_eq!([called(&demo, "amount"), called(&demo, "count")], ["Demo: How much", "Demo: Count"]);
        assert_eq!(title("camera.lens"), "Camera: lens");
    }

    #[test]
    fn ratio_parameters_are_declared_by_ratio() {
        assert_eq!(
            Demo::default().specs().iter().map(|s| s.by_ratio).collect::<Vec<_>>(),
            [false, false, false, true, false, false]
        );
    }

    #[test]
    fn parameters_made_idle_by_another_are_marked() {
        let idle = |demo: &Demo| demo.specs().iter().map(|spec| spec.idle(demo)).collect::<Vec<_>>();
        assert_eq!(idle(&Demo::default()), [const { None }; 6]);
        let off = idle(&Demo { method: Method::Off, ..Demo::default() });
        assert_eq!(off[3].as_deref(), Some("only where “Method” is not off"));
        assert_eq!(off[4].as_deref(), Some("only where “Method” is good"));
        assert_eq!(off[5], off[4], "it hangs on what is idle");
        assert_eq!(off[..3], [const { None }; 3]);
    }

    #[test]
    fn every_default_lies_in_its_own_range() {
        let mut demo = Demo::default();
        for spec in demo.specs() {
            demo.set(spec.name, &spec.default).unwrap();
        }
        assert_eq!(demo, Demo::default());
    }
}
