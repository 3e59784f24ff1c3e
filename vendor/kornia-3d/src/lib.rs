//! Stands for the crate of this name. kornia-apriltag names its solver for a flat tag's pose in one
//! method, which Locard never calls: poses come from all tags of a board, through the lens's
//! distortion. The crate itself brings 85 others along and takes minutes to build.

pub mod camera {
    /// Never made.
    #[derive(Debug)]
    pub struct PinholeCamera(());
}

pub mod pose {
    use std::fmt;

    /// Never made.
    #[derive(Debug)]
    pub struct PlanarPosePair(());

    /// Nothing is solved here.
    #[derive(Debug)]
    pub struct PlanarPoseError;

    impl fmt::Display for PlanarPoseError {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("this build has no solver for a single tag's pose")
        }
    }

    impl std::error::Error for PlanarPoseError {}

    /// Always an error.
    pub fn estimate_planar_pose<O, I>(
        _: &[O; 4],
        _: &[I; 4],
        _: &super::camera::PinholeCamera,
        _: usize,
    ) -> Result<PlanarPosePair, PlanarPoseError> {
        Err(PlanarPoseError)
    }
}
