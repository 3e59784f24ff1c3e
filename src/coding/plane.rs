//! A plane of samples.

/// One plane of samples, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePlane<T> {
    pub width: usize,
    pub height: usize,
    pub samples: Vec<T>,
}

impl<T> SamplePlane<T> {
    /// A plane of the values of `of(x, y)`.
    pub fn new(width: usize, height: usize, of: impl Fn(usize, usize) -> T) -> Self {
        let of = &of;
        let samples = (0..height).flat_map(|y| (0..width).map(move |x| of(x, y))).collect();
        Self { width, height, samples }
    }

    pub fn map<U>(&self, of: impl Fn(&T) -> U) -> SamplePlane<U> {
        SamplePlane { width: self.width, height: self.height, samples: self.samples.iter().map(of).collect() }
    }
}

impl<T: Copy> SamplePlane<T> {
    pub fn at(&self, x: usize, y: usize) -> T {
        self.samples[y * self.width + x]
    }

    /// Its top left part, at most `width` × `height` samples.
    pub fn cropped(&self, width: usize, height: usize) -> Self {
        Self::new(width.min(self.width), height.min(self.height), |x, y| self.at(x, y))
    }
}
