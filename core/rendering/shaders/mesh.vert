#version 330 core
// The names of uniforms, defines and attribute locations are those that pyrender sets.
layout(location = 0) in vec3 position;
#ifdef NORMAL_LOC
layout(location = NORMAL_LOC) in vec3 normal;
out vec3 view_normal;
#endif
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord;
out vec2 uv;
#endif
#ifdef TEXCOORD_1_LOC
layout(location = TEXCOORD_1_LOC) in vec2 emission_texcoord;
out vec2 emission_uv;
#endif
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 vertex_color;
out vec4 tint;
#endif
uniform mat4 V;
uniform mat4 P;
out vec3 view_position;

void main() {
    vec4 seen = V * vec4(position, 1.0);
    view_position = seen.xyz;
    gl_Position = P * seen;
#ifdef NORMAL_LOC
    view_normal = mat3(V) * normal;
#endif
#ifdef TEXCOORD_0_LOC
    uv = texcoord;
#endif
#ifdef TEXCOORD_1_LOC
    emission_uv = emission_texcoord;
#endif
#ifdef COLOR_0_LOC
    tint = vertex_color;
#endif
}
