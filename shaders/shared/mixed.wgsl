// A pixel in the mixed stage.
struct Mixed {
    // Code values as fractions of full scale. They may exceed 1 until the very end, where they
    // clip.
    code: vec3<f32>,
    // Variance that the camera's share of the pixel contributes, in squared 8-bit codes.
    camera_variance: vec3<f32>,
    // Share of the pixel that is virtual, 0 to 1: its coverage, or its share of the light where a
    // glow extends over real pixels.
    virtual_share: vec3<f32>,
}
