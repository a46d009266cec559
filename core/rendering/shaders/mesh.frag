#version 330 core
// Matte shading under three lights that move with the camera. Metal and gloss are left out on purpose: the picture
// is there to judge colours and relief, and without an environment to reflect a metal would only be black. Emission is
// added to the lit colour, and unlit materials are left as they are, as three.js does.
in vec3 view_position;
#ifdef NORMAL_LOC
in vec3 view_normal;
#endif
#ifdef TEXCOORD_0_LOC
in vec2 uv;
#endif
#ifdef TEXCOORD_1_LOC
in vec2 emission_uv;
#endif
#ifdef COLOR_0_LOC
in vec4 tint;
#endif

struct Material {
    vec4 base_color_factor;
    vec3 emissive_factor;
    float metallic_factor;  // carries the alpha below which a fragment is dropped
    float roughness_factor;  // carries 0.5 where the material is unlit, and 0.25 more where it is blended
#ifdef HAS_BASE_COLOR_TEX
    sampler2D base_color_texture;
#endif
#ifdef HAS_EMISSIVE_TEX
    sampler2D emissive_texture;
#endif
};
uniform Material material;
out vec4 fragment;

// Directions to the lights in view space: x right, y up, z to the camera. The key light comes from the upper left
// and grazes what faces the camera, so that letters in relief show a bright and a dark side.
const vec3 KEY = normalize(vec3(-0.75, 0.75, 0.55));
const vec3 FILL = normalize(vec3(0.6, 0.1, 0.8));
const vec3 RIM = normalize(vec3(0.2, 0.5, -0.8));

void main() {
    // The geometric normal, always turned to the camera: from its derivatives, so before any fragment is dropped.
    vec3 facing = cross(dFdx(view_position), dFdy(view_position));
    float extent = length(facing);
    vec3 n = extent > 0.0 ? facing / extent : vec3(0.0, 0.0, 1.0);
#ifdef NORMAL_LOC
    float len = length(view_normal);
    if (len > 1e-6) {
        vec3 smooth_n = view_normal / len;
        // Seen from behind (double-sided materials, inside-out meshes) a surface is lit as from its front.
        n = dot(smooth_n, n) < 0.0 ? -smooth_n : smooth_n;
    }
#endif

    vec4 color = material.base_color_factor;
#ifdef HAS_BASE_COLOR_TEX
    vec4 texel = texture(material.base_color_texture, uv);
    color *= vec4(pow(texel.rgb, vec3(2.2)), texel.a);
#endif
#ifdef COLOR_0_LOC
    color *= tint;
#endif
    if (color.a < material.metallic_factor) discard;

    vec3 emission = material.emissive_factor;
#ifdef HAS_EMISSIVE_TEX
    emission *= pow(texture(material.emissive_texture, emission_uv).rgb, vec3(2.2));
#endif

    float light = mix(0.10, 0.30, 0.5 + 0.5 * n.y)
        + 0.72 * max(dot(n, KEY), 0.0)
        + 0.22 * max(dot(n, FILL), 0.0)
        + 0.10 * max(dot(n, RIM), 0.0);
    bool unlit = material.roughness_factor > 0.4;
    bool blended = material.roughness_factor - (unlit ? 0.5 : 0.0) > 0.1;
    vec3 lit = color.rgb * (unlit ? 1.0 : light);
    // Where nothing shines through, alpha is free to tell how much of what is seen is made by light.
    float glow = dot(emission, vec3(1.0));
    float shaded = unlit ? 0.0 : glow > 0.0 ? 1.0 - glow / (glow + dot(lit, vec3(1.0))) : 1.0;
    fragment = vec4(pow(clamp(lit + emission, 0.0, 1.0), vec3(1.0 / 2.2)), blended ? color.a : shaded);
}
