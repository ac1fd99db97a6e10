// The scene's lights.
const int POINT = 0;
const int SPOT = 1;
const int DIRECTIONAL = 2;
const int RECT = 3;

struct Light {
    vec4 position;  // relative space (directional: unit vector towards the light); w: radius, or its tangent; rectangle with an
                    // image: the largest of it
    vec4 color;     // intensity, irradiance or radiance; w: kind
    vec4 u;         // rectangle: half edge, w = distance up to which points are in its plane; spot: axis; directional: x = half
                    // width of its map, y = how far off blockers are searched; of its near cascade, z = half width, w = texels
    vec4 v;         // rectangle: half edge, w = two-sided; spot: inner and outer half angle in radians; directional: xy = centre
                    // of its near cascade relative to that of its map, zw = corner
    vec4 tile;      // shadow map: corner and face size in texels, kind of map; without one: first row of its emission points,
                    // and their number
    vec4 frame_x;   // axes of a single map; rectangle: direction of u, w = its length
    vec4 frame_y;   // rectangle: direction of v, w = its length
    vec4 frame_z;   // rectangle: unit normal, along u x v; w = 1 plus the layer of its image, 0 without one
};

layout(std140) uniform LightBlock {
    Light lights[LIGHT_COUNT > 0 ? LIGHT_COUNT : 1];
};
