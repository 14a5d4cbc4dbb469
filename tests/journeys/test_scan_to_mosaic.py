def test_x__truth(tiny_run):
    pass
