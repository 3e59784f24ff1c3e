//! Text of a USD layer, indented.

use std::fmt::{self, Display};

use glam::{DAffine3, DVec3};

use crate::text::number;

#[derive(Debug, Default)]
pub struct UsdWriter {
    pub text: String,
    depth: usize,
}

impl UsdWriter {
    /// A writer at a level of indentation.
    pub fn at_depth(depth: usize) -> Self {
        Self { text: String::new(), depth }
    }

    pub fn line(&mut self, line: impl Display) {
        (0..self.depth).for_each(|_| self.text.push_str("    "));
        let _ = fmt::Write::write_fmt(&mut self.text, format_args!("{line}\n"));
    }

    /// A prim or a block in braces, with its contents.
    pub fn block(&mut self, head: impl Display, write: impl FnOnce(&mut Self)) {
        self.line(head);
        self.line("{");
        self.depth += 1;
        write(self);
        self.depth -= 1;
        self.line("}");
    }

    /// `name.timeSamples = { time: value, … }`.
    pub fn time_samples(&mut self, name: impl Display, samples: impl IntoIterator<Item = (i64, String)>) {
        self.line(format_args!("{name}.timeSamples = {{"));
        self.depth += 1;
        for (time, value) in samples {
            self.line(format_args!("{time}: {value},"));
        }
        self.depth -= 1;
        self.line("}");
    }

    /// A transform as the prim's only operation.
    pub fn transform(&mut self, transform: &DAffine3) {
        self.line(format_args!("matrix4d xformOp:transform = {}", matrix(transform)));
        self.line(TRANSFORM_ORDER);
    }

    /// An attribute with a value for each vertex.
    pub fn per_vertex(&mut self, name: &str, values: impl Display) {
        self.line(format_args!("{name} = [{values}] ("));
        self.line("    interpolation = \"vertex\"");
        self.line(")");
    }
}

pub const TRANSFORM_ORDER: &str = "uniform token[] xformOpOrder = [\"xformOp:transform\"]";

/// A transform as USD writes it, for row vectors: the last row is the translation.
pub fn matrix(transform: &DAffine3) -> String {
    let row = |v: DVec3, w: u8| format!("({}, {}, {}, {w})", number(v.x), number(v.y), number(v.z));
    let m = transform.matrix3;
    format!("( {}, {}, {}, {} )", row(m.x_axis, 0), row(m.y_axis, 0), row(m.z_axis, 0), row(transform.translation, 1))
}

/// Values with commas between.
pub fn list<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    values.into_iter().map(|value| value.to_string()).collect::<Vec<_>>().join(", ")
}

pub fn tuple<const N: usize>(values: [f32; N]) -> String {
    format!("({})", list(values))
}
