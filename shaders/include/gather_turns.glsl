// Which texels of the grid of gathered light trace rays in a frame, as in app/passes/gather_turns.py.
uniform sampler2D surfaces;  // normal and depth, which is negative where history knows nothing
uniform int turns;           // of how many frames a texel traces rays in one
uniform int turn;

bool has_turn(ivec2 texel)
{
    return (texel.y % 2 * 2 + (texel.x ^ texel.y) % 2) % turns == turn;
}

bool is_wanted(ivec2 texel, vec4 surface)
{
    return is_finite(dot(surface, vec4(1.0))) && (surface.a < 0.0 || surface.a > 0.0 && has_turn(texel));
}
