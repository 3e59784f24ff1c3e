//! A number that is calibrated.

/// A parameter with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in a profile.
    pub name: &'static str,
    pub value: f64,
    /// One standard deviation, in the parameter's unit.
    pub sigma: f64,
}
