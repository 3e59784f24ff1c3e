//! The declarations: [`params!`](crate::params!) and [`choices!`](crate::choices!).

/// Declares an enum whose variants have names in text, for use as a parameter.
#[macro_export]
macro_rules! choices {
    ($(#[$meta:meta])* pub enum $name:ident { $($(#[$vmeta:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $($(#[$vmeta])* $variant),+ }
        impl $crate::params::Field for $name {
            fn kind(_: Option<(f64, f64)>) -> $crate::params::Kind {
                $crate::params::Kind::Choice(&[$($text),+])
            }
            fn to_value(&self) -> $crate::params::Value {
                $crate::params::Value::Text(match self { $(Self::$variant => $text),+ }.to_owned())
            }
            fn from_value(value: &$crate::params::Value, _: &$crate::params::Kind) -> Option<Self> {
                // Values are parsed before it is known that a name is expected, so a name such as
                // `off` may arrive as a boolean.
                let is = |text: &str| {
                    matches!(value, $crate::params::Value::Text(t) if t == text)
                        || *value == $crate::params::Value::parse(text)
                };
                $(if is($text) { return Some(Self::$variant); })+
                None
            }
        }
    };
}

/// Declares a table of parameters. After a name, `as` gives the label of a user interface, if the
/// field's own words read badly; `=> other is` or `=> other isnt` names the value of another
/// parameter, or several (`"a or b"`), with which this one has an effect. `at` names the first
/// [`Stage`](crate::stage::Stage) that reads the parameters of a table, or one of them.
///
/// ```
/// locard_engine::params! {
///     /// How to paint.
///     pub struct Paint in "paint" {
///         "how thick the coat is"
///         thickness_mm: f32 = 0.5, "mm", 0.0..=3.0;
///         "whether to varnish"
///         varnish: bool = true;
///         "how much the varnish shines"
///         shine: f32 = 0.5, "1", 0.0..=1.0 => varnish is "true";
///     }
/// }
/// use locard_engine::params::{Params, Value};
/// let mut paint = Paint::default();
/// paint.set("thickness_mm", &Value::Number(1.0)).unwrap();
/// assert!(paint.set("thickness_mm", &Value::Number(4.0)).is_err());
/// assert_eq!(paint.thickness_mm, 1.0);
/// ```
#[macro_export]
macro_rules! params {
    ($(#[$meta:meta])* pub struct $name:ident in $table:literal $(at $table_stage:ident)? {
        $($help:literal $field:ident $(as $called:literal)? $(at $stage:ident)? : $type:ty = $default:expr $(, $unit:literal, $range:expr $(, $scale:ident)?)?
            $(=> $other:ident $relation:ident $value:literal)? ;)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name { $(#[doc = $help] pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self { Self { $($field: $default,)* } }
        }
        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
                serde::Serialize::serialize(&$crate::params::values(self), to)
            }
        }
        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                $crate::params::of_values(serde::Deserialize::deserialize(from)?).map_err(serde::de::Error::custom)
            }
        }
        impl $crate::params::Params for $name {
            fn table(&self) -> &'static str { $table }
            fn table_stage(&self) -> Option<$crate::stage::Stage> {
                #[allow(unused_mut, unused_assignments)]
                let mut stage = None;
                $(stage = Some($crate::stage::Stage::$table_stage);)?
                stage
            }
            fn specs(&self) -> Vec<$crate::params::Spec> {
                let default = Self::default();
                vec![$({
                    #[allow(unused_mut, unused_assignments)]
                    let mut range: Option<(f64, f64)> = None;
                    #[allow(unused_mut, unused_assignments)]
                    let mut unit = "";
                    #[allow(unused_mut, unused_assignments)]
                    let mut by_ratio = false;
                    #[allow(unused_mut, unused_assignments)]
                    let mut called = None;
                    #[allow(unused_mut, unused_assignments)]
                    let mut acts_if = None;
                    #[allow(unused_mut, unused_assignments)]
                    let mut stage = self.table_stage();
                    $(stage = Some($crate::stage::Stage::$stage);)?
                    $(called = Some($called);)?
                    $(acts_if = Some($crate::params::ActsIf {
                        other: stringify!($other), is: $crate::is_or_isnt!($relation), value: $value,
                    });)?
                    $($(by_ratio = $crate::by_ratio!($scale);)?)?
                    $(range = Some({ let r: std::ops::RangeInclusive<f64> = $range; (*r.start(), *r.end()) }); unit = $unit;)?
                    $crate::params::Spec {
                        name: stringify!($field),
                        called,
                        unit,
                        kind: <$type as $crate::params::Field>::kind(range),
                        default: $crate::params::Field::to_value(&default.$field),
                        optional: <$type as $crate::params::Field>::OPTIONAL,
                        help: $help,
                        by_ratio,
                        acts_if,
                        stage,
                    }
                },)*]
            }
            fn get(&self, name: &str) -> Option<$crate::params::Value> {
                match name { $(stringify!($field) => Some($crate::params::Field::to_value(&self.$field)),)* _ => None }
            }
            fn set(&mut self, name: &str, value: &$crate::params::Value) -> Result<(), $crate::params::ParamError> {
                let specs = self.specs();
                let Some(spec) = specs.iter().find(|spec| spec.name == name) else {
                    return Err($crate::params::unknown_name($table, name, &specs));
                };
                match name {
                    $(stringify!($field) => match $crate::params::Field::from_value(value, &spec.kind) {
                        Some(v) => { self.$field = v; Ok(()) }
                        None => Err($crate::params::refused($table, spec, value)),
                    },)*
                    _ => Err($crate::params::unknown_name($table, name, &specs)),
                }
            }
        }
    };
}

/// The words that may follow a range in [`params!`](crate::params!).
#[doc(hidden)]
#[macro_export]
macro_rules! by_ratio {
    (by_ratio) => {
        true
    };
}

/// The words that may follow another parameter in [`params!`](crate::params!).
#[doc(hidden)]
#[macro_export]
macro_rules! is_or_isnt {
    (is) => {
        true
    };
    (isnt) => {
        false
    };
}
