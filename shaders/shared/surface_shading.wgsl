// Surface shading: lights, environment and the room. It reads the bindings of raster.wgsl.

struct Surface {
    matt: vec3<f32>,   // diffuse reflectance
    f0: vec3<f32>,
    // The factor by which light that leaves after several bounces between facets raises that of one
    // bounce.
    gain: vec3<f32>,
    a2: f32,           // roughness⁴
    normal: vec3<f32>,
    smooth_normal: vec3<f32>, // without the normal map
    towards_eye: vec3<f32>,
    n_v: f32,
}

// GGX with Smith's height-correlated visibility, as in glTF 2.0 appendix B; times π.
fn specular_pi(s: Surface, n_l: f32, h: vec3<f32>) -> f32 {
    // 1 − (n·h)² as a squared sine: computed as a difference, the peak of a smooth surface would
    // drown in rounding.
    let n_h = dot(s.normal, h);
    let sine = cross(s.normal, h);
    let f = dot(sine, sine) + n_h * n_h * s.a2;
    let visibility = 0.5 / (n_l * sqrt(s.n_v * s.n_v * (1.0 - s.a2) + s.a2) + s.n_v * sqrt(n_l * n_l * (1.0 - s.a2) + s.a2));
    return s.a2 / (f * f) * visibility;
}

// The radiance towards the eye from one light. A white diffuse surface would have the radiance
// `color`.
fn lit(s: Surface, towards: vec3<f32>, color: vec3<f32>) -> vec3<f32> {
    let n_l = dot(s.normal, towards);
    // A bump gets no light where its underlying surface faces away, and little close to there: at
    // most ten times as much as that surface. Without a normal map this is n_l.
    let reached = min(n_l, 10.0 * dot(s.smooth_normal, towards));
    if reached <= 0.0 {
        return vec3<f32>(0.0);
    }
    let h = normalize(towards + s.towards_eye);
    let away = 1.0 - clamp(dot(s.towards_eye, h), 0.0, 1.0);
    let f = s.f0 + (1.0 - s.f0) * (away * away * away * away * away);
    return color * reached * (s.matt + f * s.gain * specular_pi(s, n_l, h));
}

// Where a direction lies in the environment's picture, 0 to 1: y is up, −z is in the middle.
fn on_map(direction: vec3<f32>) -> vec2<f32> {
    let d = vec3<f32>(dot(light.map_rows[0].xyz, direction), dot(light.map_rows[1].xyz, direction), dot(light.map_rows[2].xyz, direction));
    return vec2<f32>(atan2(d.x, -d.z) / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
}

// The radiance of a white diffuse surface with this normal: render/irradiance.rs.
fn irradiance_over_pi(n: vec3<f32>) -> vec3<f32> {
    if !has_map {
        return light.environment.xyz;
    }
    // The first and the last row lie on the poles.
    let rows = f32(textureDimensions(irradiance_table).y);
    let at = on_map(n);
    let between = vec2<f32>(at.x, (at.y * (rows - 1.0) + 0.5) / rows);
    return textureSampleLevel(irradiance_table, environment_sampler, between, 0.0).rgb;
}

// The environment's radiance, blurred by a lobe of this roughness around the direction.
fn radiance(direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    if !has_map {
        return light.environment.xyz;
    }
    return textureSampleLevel(environment, environment_sampler, on_map(direction), roughness * (light.environment.w - 1.0)).rgb;
}

// Scale and bias of F0 under uniform light, and the mean of their sum over all views:
// render/albedo.rs.
fn albedo(roughness: f32, n_v: f32) -> vec3<f32> {
    // From the centre of the first texel to the centre of the last.
    let at = (vec2<f32>(sqrt(n_v), roughness) * (ALBEDO_STEPS - 1.0) + 0.5) / ALBEDO_STEPS;
    return textureSampleLevel(albedo_table, environment_sampler, at, 0.0).xyz;
}

// Incident light at a surface point: the visible share of the environment, by channel, the light
// that other objects reflect, and the visible share of each sun and lamp.
struct IncidentLight { sky_visibility: vec3<f32>, indirect: vec3<f32>, light_visibility: array<f32, MAX_LIGHTS> }

fn incident_light(at: vec2<f32>, front: bool) -> IncidentLight {
    var incident = IncidentLight(vec3<f32>(1.0), vec3<f32>(0.0), array<f32, MAX_LIGHTS>());
    for (var i = 0u; i < MAX_LIGHTS; i++) {
        incident.light_visibility[i] = 1.0;
    }
    if !has_lightmap {
        return incident;
    }
    let own = 2u + (max(suns + points, 2u) + 1u) / 4u;
    // A single-sided surface has no layers for its back.
    let first = select(min(own, textureNumLayers(lightmap) - own), 0u, front);
    let around = textureSampleLevel(lightmap, environment_sampler, at, first, 0.0);
    let other = textureSampleLevel(lightmap, environment_sampler, at, first + 1u, 0.0);
    let strength = light.strength.x;
    incident.sky_visibility = max(1.0 - strength * (1.0 - around.rgb), vec3<f32>(0.0));
    incident.indirect = strength * other.rgb;
    incident.light_visibility[0] = around.a;
    incident.light_visibility[1] = other.a;
    for (var i = 2u; i < suns + points; i += 4u) {
        let more = textureSampleLevel(lightmap, environment_sampler, at, first + 2u + (i - 2u) / 4u, 0.0);
        for (var n = 0u; n < 4u; n++) {
            incident.light_visibility[i + n] = more[n];
        }
    }
    for (var i = 0u; i < suns + points; i++) {
        incident.light_visibility[i] = max(1.0 - strength * (1.0 - incident.light_visibility[i]), 0.0);
    }
    return incident;
}

fn shade(in: Fragment, front: bool, base: vec3<f32>) -> vec3<f32> {
    var metallic = material.metallic;
    var roughness = material.roughness;
    if has_metallic_roughness {
        let mr = textureSample(metallic_roughness_texture, metallic_roughness_sampler, texture_uv(in, 1u));
        metallic *= mr.b;
        roughness *= mr.g;
    }
    roughness = clamp(roughness, 0.045, 1.0);
    var shadowed = 1.0;
    if has_occlusion {
        let occlusion = textureSample(occlusion_texture, occlusion_sampler, texture_uv(in, 3u)).r;
        shadowed += material.occlusion * (occlusion - 1.0);
    }

    let smooth_normal = select(-1.0, 1.0, front) * normalize(in.normal);
    var n = normalize(in.normal);
    if has_normals {
        let bump = textureSample(normal_texture, normal_sampler, texture_uv(in, 2u)).xyz * 2.0 - 1.0;
        if dot(in.tangent.xyz, in.tangent.xyz) > 0.0 {
            let t = normalize(in.tangent.xyz - n * dot(n, in.tangent.xyz));
            let b = cross(n, t) * in.tangent.w;
            n = normalize(t * (bump.x * material.normal_scale) + b * (bump.y * material.normal_scale) + n * bump.z);
        }
    }
    if !front {
        n = -n;
    }
    // The eye is the origin: positions are relative to the camera.
    var towards_eye = -normalize(in.position);
    if parallel {
        let q = view.rotation;
        towards_eye = rotate(vec4<f32>(-q.xyz, q.w), vec3<f32>(0.0, 0.0, -1.0));
    }
    let n_v = clamp(dot(n, towards_eye), 1e-3, 1.0);
    let f0 = mix(vec3<f32>(0.04), base, metallic);
    let once = albedo(roughness, n_v);
    // Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks": the light that one
    // bounce between facets loses, tinted by the bounces that follow. For dielectrics it is next to
    // nothing. Schlick's mean is F0 + (1 − F0)/21.
    let f_mean = min(base + (1.0 - base) / 21.0, vec3<f32>(1.0));
    let more = f_mean * once.z / (1.0 - f_mean * (1.0 - once.z)) * (1.0 / (once.x + once.y) - 1.0);
    let gain = 1.0 + more * base * metallic / max(f0, vec3<f32>(1e-4));
    // A dielectric's diffuse layer gets the light that its specular layer transmits. A metal has
    // nothing below it.
    let matt = base * (1.0 - metallic) * (1.0 - 0.04 * once.x - once.y);
    let s = Surface(matt, f0, gain, roughness * roughness * roughness * roughness, n, smooth_normal, towards_eye, n_v);

    var sum = vec3<f32>(0.0);
    let incident = incident_light(in.on_lightmap, front);
    for (var i = 0u; i < suns; i++) {
        sum += lit(s, light.sun_towards[i].xyz, light.sun_color[i].xyz * incident.light_visibility[i]);
    }
    for (var i = 0u; i < points; i++) {
        let point = light.points[i];
        let to = point.position.xyz - in.position;
        let d2 = max(dot(to, to), 1e-6);
        let towards = to * inverseSqrt(d2);
        // KHR_lights_punctual: inverse square, windowed by the range; spot by its two angles.
        let x = d2 * point.position.w * point.position.w;
        var falloff = clamp(1.0 - x * x, 0.0, 1.0) / d2;
        if point.spot.w > -1.5 {
            let c = dot(point.spot.xyz, -towards);
            let ramp = clamp((c - point.spot.w) / max(point.spot_inner.x - point.spot.w, 1e-4), 0.0, 1.0);
            falloff *= ramp * ramp;
        }
        sum += lit(s, towards, point.color.xyz * (falloff * incident.light_visibility[suns + i]));
    }
    // A bump sees its own surface where it does not see the sky.
    let sky = mix(base, vec3<f32>(1.0), 0.5 + 0.5 * dot(n, smooth_normal));
    let specular = (f0 * once.x + once.y) * gain;
    // A model's own occlusion texture and the lightmap describe the same light: the smaller value
    // counts.
    let open = min(vec3<f32>(shadowed), incident.sky_visibility);
    // Visible share of a mirror image's light, from the visible share of all light: Lagarde and de
    // Rousiers 2014, "Moving Frostbite to Physically Based Rendering", section 4.10.2.
    let mirrored = clamp(pow(n_v + open, vec3<f32>(exp2(-16.0 * roughness - 1.0))) - 1.0 + open, vec3<f32>(0.0), vec3<f32>(1.0));
    return sum + (irradiance_over_pi(n) * open + incident.indirect) * sky * matt
        + radiance(reflect(-towards_eye, n), roughness) * specular * mirrored;
}
