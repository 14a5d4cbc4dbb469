"""Where a block lies."""


def test_the_search_has_room_for_what_the_photos_may_be_off__law(placed):
    inner, outer = placed.block.bounds, placed.block.search_bounds
    sigma = max(p.prior.sigma_centre_m[:2].max() for p in placed.block.photos.values())
    for low, wide in zip(inner[:2], outer[:2], strict=True):
        assert low - wide >= 3 * sigma
    for high, wide in zip(inner[2:], outer[2:], strict=True):
        assert wide - high >= 3 * sigma
