// A full-screen copy: the yardstick that pass budgets are measured in.
uniform sampler2D source;
layout(location = 0) out vec4 out_copy;

void main()
{
    out_copy = texelFetch(source, ivec2(gl_FragCoord.xy), 0);
}
