//! How exact a derived value is.

/// A preview is an approximation that is ready within a frame's time and may reuse earlier results.
/// A final value
/// is the one that a new program would compute from the same inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    Preview,
    #[default]
    Final,
}

impl Quality {
    pub fn is_preview(self) -> bool {
        self == Self::Preview
    }
}

impl crate::digest::Digestible for Quality {
    fn digest(&self, into: &mut crate::digest::Digester) {
        into.add(&self.is_preview());
    }
}
