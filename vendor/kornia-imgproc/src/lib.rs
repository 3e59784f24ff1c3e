//! Stands for the crate of this name. Of its 75,000 lines kornia-apriltag calls two functions: the
//! features of the processor, and the weights of a blur. The crate itself takes as long to build
//! as the window's toolkit.

pub mod simd {
    use std::sync::OnceLock;

    /// The processor's features for which the tag detector has code.
    #[derive(Clone, Copy, Debug)]
    pub struct CpuFeatures {
        pub has_avx2: bool,
        pub has_fma: bool,
    }

    /// Queried from the processor once.
    pub fn cpu_features() -> &'static CpuFeatures {
        static FOUND: OnceLock<CpuFeatures> = OnceLock::new();
        FOUND.get_or_init(detected_features)
    }

    #[cfg(target_arch = "x86_64")]
    fn detected_features() -> CpuFeatures {
        CpuFeatures {
            has_avx2: std::is_x86_feature_detected!("avx2"),
            has_fma: std::is_x86_feature_detected!("fma"),
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn detected_features() -> CpuFeatures {
        CpuFeatures { has_avx2: false, has_fma: false }
    }
}

pub mod filter {
    pub mod kernels {
        /// A Gaussian's weights at `size` whole steps around its middle, in the sum 1.
        pub fn gaussian_kernel_1d(size: usize, sigma: f32) -> Vec<f32> {
            let middle = (size.max(1) - 1) as f32 / 2.0;
            let weight = |i| (-(i as f32 - middle).powi(2) / (2.0 * (sigma * sigma))).exp();
            let weights: Vec<f32> = (0..size).map(weight).collect();
            let sum: f32 = weights.iter().sum();
            weights.into_iter().map(|weight| weight / sum).collect()
        }
    }
}
