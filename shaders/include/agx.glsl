// AgX (Sobotka 2019-2022): linear Rec. 709 to values for a display with an exponent of 2.2.
// The inset, its inverse and the range are those of Wrensch, "Minimal AgX Implementation" (2023); the curve is Sobotka's
// own, of which that has a polynomial.
const mat3 AGX_INSET = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051,
                            0.0784335999999992, 0.878468636469772, 0.0784336,
                            0.0792237451477643, 0.0791661274605434, 0.879142973793104);
const mat3 AGX_OUTSET = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438,
                             -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
                             -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
const float AGX_MIN_EV = -12.47393, AGX_MAX_EV = 4.026069;  // 10 stops below and 6.5 above middle grey
const vec2 AGX_PIVOT = vec2(10.0 / 16.5, 0.5);              // where middle grey is, before and after the curve
const float AGX_SLOPE = 2.0;                                // there
const float AGX_TOE = 3.0, AGX_SHOULDER = 3.25;             // exponents

// Half of the curve, from the pivot to a limit at the given distances: a hyperbola with that exponent.
vec3 agx_half(vec3 x, vec2 limit, float exponent)
{
    float rise = AGX_SLOPE * limit.x / limit.y;
    float scale = AGX_SLOPE * limit.x * pow(pow(rise, exponent) - 1.0, -1.0 / exponent);
    vec3 term = AGX_SLOPE * x / scale;
    return scale * term / pow(1.0 + pow(term, vec3(exponent)), vec3(1.0 / exponent));
}

vec3 agx(vec3 x)
{
    vec3 stops = log2(max(AGX_INSET * x, 1e-10));
    vec3 away = clamp((stops - AGX_MIN_EV) / (AGX_MAX_EV - AGX_MIN_EV), 0.0, 1.0) - AGX_PIVOT.x;
    vec3 below = agx_half(max(-away, 0.0), AGX_PIVOT, AGX_TOE);
    vec3 above = agx_half(max(away, 0.0), 1.0 - AGX_PIVOT, AGX_SHOULDER);
    return clamp(AGX_OUTSET * (AGX_PIVOT.y - below + above), 0.0, 1.0);
}
