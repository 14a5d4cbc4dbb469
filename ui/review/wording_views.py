"""Words of the views laid over the desk (fiducials, film, placement) and of the placing page."""

VIEWS: dict[str, str] = {
    # fiducial board
    "board": "Fiducials",
    "board.tip": "Every photo by every mark, most doubtful first: look, correct, leave out",
    "board.board": "Board",
    "board.film": "Film",
    "board.count": "{photos} photos \u00b7 {doubtful} doubtful marks",
    "board.none": "No camera of this block has fiducials: give fiducials_mm in block.toml, or let "
    "the marks be found by a new run.",
    "board.hidden": "left out",
    "board.missing": "not found",
    "board.scan-doubt": "Remarks: {count}",
    "board.state": "State",
    "board.state.used": "in use, as found",
    "board.state.placed": "in use, placed by hand",
    "board.state.hidden": "left out by hand",
    "board.state.unused": "left out: it does not fit the others",
    "board.state.missing": "not found",
    "board.residual": "Residual x, y",
    "board.residual.tip": "On the film: where it is measured minus where the certificate puts it; "
    "of marks that are not used what it would be",
    "board.score": "Score",
    "board.score.tip": "Likeness to the drawn mark, 0 to 1",
    "board.apart": "Two ways differ by",
    "board.apart.tip": "Every mark is centred in two independent ways",
    "board.sigma": "Sigma",
    "board.place": "Measured at",
    "board.rms": "Scan RMS",
    "board.model.similarity": "similarity",
    "board.model.affine": "affine",
    "board.model.projective": "projective",
    "board.model.bilinear": "bilinear",
    "board.model.nominal": "no orientation",
    "board.keep": "Keep",
    "board.keep.tip": "The mark is right as it is; go to the next doubtful one",
    "board.hide": "Not visible",
    "board.hide.tip": "The mark cannot be seen or is wrong: the scan is oriented without it",
    "board.snap": "Snap",
    "board.snap.tip": "Move it onto the mark beside it, by the same mark in another scan or by "
    "its symmetry",
    "board.undo": "Undo",
    "board.undo.tip": "Take back your last decision",
    "board.next": "Next doubtful mark (J)",
    "board.previous": "The one before (K)",
    "board.said": "Decided by {who}, {when} UTC",
    "board.hint": "Click places the mark, arrows nudge it by 0.1 px (Shift: 1 px), drag moves, "
    "wheel zooms. Dashed: where the other marks put it.",
    "board.run": "The block is adjusted with it at once. The next gruber run orients the scan "
    "with it and makes anew all that follows.",
    "notice.snapped": "{name} snapped: moved by {distance} px, likeness {alike}.",
    "notice.not-snapped": "Not snapped: {why}.",
    "notice.undo.PlaceFiducial": "Taken back: fiducial {what} placed by hand",
    "notice.redo.PlaceFiducial": "Again: fiducial {what} placed by hand",
    "did.PlaceFiducial": "fiducial placed",
    # placing page
    "placing": "Placing by hand",
    "placing.why": "No photo of this block stands on the reference ortho yet. Click two places, far "
    "apart, that you recognise in one photo and in the ortho: tie points carry them to the others. "
    "More pairs check each other.",
    "placing.scans": "Photos (J, K)",
    "placing.unknown": "no place known",
    "placing.pairs": "Pairs in {scan}",
    "placing.pairs.count": "{count} pairs",
    "placing.pixel": "column, row",
    "placing.ground": "easting, northing",
    "placing.residual": "off",
    "placing.remove": "Remove this pair",
    "placing.now.click": "Click the same place in the photo and in the ortho, in either order.",
    "placing.now.ortho": "Now click the same place in the ortho.",
    "placing.now.scan": "Now click the same place in the photo.",
    "placing.now.enough": "Enough to begin with: save, then run. One more pair shows whether they "
    "agree; the dashed ring says where it should be.",
    "placing.figures": "About 1:{scale}, a pixel is {pixel} m on the ground, turned by "
    "{turn}\u00b0.",
    "placing.rms": "A similarity through {count} pairs leaves {rms} m RMS; relief and tilt leave "
    "some tens of metres.",
    "placing.two": "Two pairs fit exactly: only a third would show a mistake.",
    "placing.save": "Save",
    "placing.was": "These were saved before.",
    "placing.saved": "Saved as {file}.",
    "placing.removed": "The file of points was removed.",
    "placing.hint": "Drag moves the picture or a mark, the wheel zooms, arrows nudge the last mark "
    "(Shift: ten times as far).",
    "placing.run.title": "Then",
    "placing.run": "Run the block",
    "placing.run.hint": "Saved points are read first. The run can be begun here or in a terminal: "
    "{command}. When it has gone through here, the desk opens in this page.",
    "placing.stage": "Stage {place} of {stages}: {title}",
    "placing.cancelled": "The run was cancelled; the next one goes on from there.",
    "placing.done": "The block stands. The desk is opening.",
}
"""English."""
