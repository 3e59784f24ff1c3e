//! stub
pub fn noise_profile_from_toml(_: &toml::Table) -> Result<crate::camera::NoiseProfile, std::fmt::Error> {
    Err(std::fmt::Error)
}
