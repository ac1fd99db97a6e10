// Six views of n texels in one picture of 4 n x 2 n (Mahmud et al. 2022, surrounding-aware screen-space GI): front in the
// middle, left and right beside it, back cut in two halves at the far sides, so that neighbours show what lies side by
// side; up stretched over the top, down over the bottom. Texels are picked, as everywhere.

// The texel of the row of views that shows at the panorama's texel ``at``, both bottom row first.
ivec2 panorama_texel(ivec2 at)
{
    const int n = CUBE_SIZE, cap = n / 2;
    if (at.y < cap) return ivec2(5 * n + at.x / 4, 2 * at.y);
    if (at.y >= cap + n) return ivec2(4 * n + at.x / 4, 2 * (at.y - cap - n));
    int x = (at.x + n / 2) % (4 * n), place = x / n;
    int face = place == 0 ? 1 : place == 1 ? 2 : place == 2 ? 0 : 3;
    return ivec2(face * n + x % n, at.y - cap);
}
