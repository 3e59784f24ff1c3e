// Shadow ratio from the fraction of light removed. The layer's file has 16-bit floats, 2⁻¹¹ apart
// below 1 and 2⁻¹⁰ apart above. Fractions that would round to a ratio of 1 in it count as 0, so
// that the composite and the file agree on the changed pixels.
const LARGEST_UNSEEN_LOSS: f32 = 1.0 / 4096.0;
const LARGEST_UNSEEN_GAIN: f32 = 1.0 / 2048.0;

fn shadow_ratio(removed: vec3<f32>) -> vec3<f32> {
    let is_none = (removed <= vec3<f32>(LARGEST_UNSEEN_LOSS)) & (removed >= vec3<f32>(-LARGEST_UNSEEN_GAIN));
    return select(1.0 - removed, vec3<f32>(1.0), is_none);
}
