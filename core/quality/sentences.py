"""Sentences for the findings of a block's judgement; `core/quality/job_rules.py` has the limits."""

from collections.abc import Mapping

SENTENCES = {
    "contradicted": "{worst} in {photo} was accepted by hand, but everything else puts it {metres} "
    "m ({pixels} px) away: {test} times its standard deviation. It moves photos by up to {shift} "
    "m.",
    "contradicted-far": "{worst} in {photo} was accepted by hand, but everything else puts it "
    "{metres} m ({pixels} px) away: {test} times its standard deviation, and it moves photos by up "
    "to {shift} m. {most} m is more than the {limit} m that a block may be off: this one cannot be "
    "released before you have looked at the measurement again.",
    "contradicted-check": "{worst}, a check point measured by hand in {photo}, lies {metres} m "
    "({pixels} px) from where the block puts it: {test} times what is predicted.",
    "contradicted-more": "Further measurements accepted by hand that the block contradicts: "
    "{count}, by up to {metres} m.",
    "agreed": "The block contradicts no measurement accepted by hand (accepted: {count}).",
    "diverged": "The adjustment did not settle.",
    "sigma": "Sigma nought {value}: residuals are as expected.",
    "sigma-off": "Sigma nought {value} lies outside {low} to {high}: weights and residuals do not "
    "fit.",
    "sigma-far": "Sigma nought {value} lies far outside {low} to {high}: nothing that is predicted "
    "of the block can be believed.",
    "sigma-none": "Sigma nought cannot be stated: no measurement is redundant, so nothing checks "
    "the block.",
    "class-large": "Residuals of {worst} are {ratio} times as large as their standard deviations "
    "say: a systematic error, or too much trust in them.",
    "control": "{count} control points in {cells} of 9 parts of the block.",
    "control-gaps": "{count} control points, but in {cells} of 9 parts only.",
    "control-few": "{count} control points ({plan} with plan, {heights} with height); a block "
    "needs {least}, at least 2 of them with plan and 3 with height.",
    "control-on-a-line": "All height control lies on a line (within {across} m of it, {along} m "
    "long): the block can turn about it. Add a point off the line.",
    "strip": "The strip of {worst}, which shows the fewest, has {count} control points.",
    "strip-few": "The strip of {worst} shows {count} control points; it needs {least}.",
    "edge-plan": "Along the block's edge control is at most {bases} bases apart.",
    "edge-heights": "Along the edge known heights are at most {bases} bases apart.",
    "edge-gap-plan": "{bases} bases of the block's edge have no control ({most} at most): add a "
    "point by {worst}, about E {east} N {north}.",
    "edge-gap-heights": "{bases} bases of the block's edge have no known height ({most} at most): "
    "add one by {worst}, about E {east} N {north}.",
    "inside-plan": "Inside the block {value} control points for each stereo model.",
    "inside-heights": "Inside the block {value} known heights for each stereo model.",
    "inside-few-plan": "Inside the block {value} control points for each stereo model; {least} are "
    "the rule.",
    "inside-few-heights": "Inside the block {value} known heights for each stereo model; {least} "
    "are the rule.",
    "unchecked": "Control measurements that no other could find wrong: {count} ({worst} in "
    "{photo}).",
    "no-checks": "No independent check points: the accuracy is predicted, not proved.",
    "one-check": "One independent check point, {value} m off with its own error: too few to judge.",
    "checks-few": "Independent check points: {count}, fewer than {least}, RMSE {value} m, {ratio} "
    "times what is predicted (by chance {low} to {high}): too few to judge.",
    "checks": "Independent check points: {count}, RMSE {value} m, {ratio} times what is predicted "
    "(by chance {low} to {high}).",
    "checks-better": "Independent check points: {count}, RMSE {value} m, {ratio} times what is "
    "predicted, less than chance explains ({low} to {high}): standard deviations are stated too "
    "large.",
    "checks-worse": "Independent check points: {count}, RMSE {value} m, {ratio} times what is "
    "predicted, more than chance explains ({low} to {high}): the prediction cannot be trusted.",
    "checks-over": "Independent check points: {count}, RMSE {value} m: the block is off by more "
    "than {limit} m.",
    "check-share": "Check points for {control} control points: {count}.",
    "check-share-few": "Check points for {control} control points: {count}; {least} are the rule.",
    "kept-out": "Proposals kept out: {count}, RMSE {value} m (not independent of the reference).",
    "one-photo": "One photo alone: only its own control can show it wrong.",
    "no-ties": "No tie points bind the photos.",
    "in-parts": "No tie points join {worst} ({photos} photos, {points} control points) to the "
    "rest.",
    "rays": "{share} % of the tie points are seen in three photos or more.",
    "rays-few": "Only {share} % of the tie points are seen in three photos or more.",
    "bare": "Photos with several empty areas, without ties or control: {count} ({worst}).",
    "systematic": "Residuals of {worst} are systematic on the film: up to {value} µm in a part of "
    "it. Self-calibration can take this up.",
    "no-pattern": "No systematic residuals on the film (mean of all photos at most {value} µm).",
    "distance": "Nobody stated the principal distance of {worst}: {value} ± {sigma} mm by this "
    "block.",
    "distance-unknown": "The block cannot tell the principal distance of {worst}: {value} ± "
    "{sigma} mm. The ground is too level or the photos are too few to part it from the flying "
    "height (correlation {correlation}). State it from the certificate or the margin, name make "
    "and model of the camera, or give flying heights.",
    "oriented": "All photos are oriented (photos: {count}).",
    "loose": "Photos that are not oriented: {count} ({worst}).",
    "tilt": "Tilts up to {value}\u00b0, within {limit}\u00b0.",
    "tilt-over": "Photos that tilt by more than {limit}\u00b0: {over}, up to {value}\u00b0 "
    "({worst}).",
    "crab": "Crab up to {value}\u00b0, within {limit}\u00b0.",
    "crab-over": "Photos with a crab of more than {limit}\u00b0: {over}, up to {value}\u00b0 "
    "({worst}).",
    "along": "Overlap along the strips {low} to {high} %.",
    "along-small": "Overlap along the strips {low} to {high} %; below {least} % in {small} photos.",
    "across": "Overlap between strips {low} to {high} %.",
    "across-small": "Overlap between strips {low} to {high} %; below {least} % in {small} photos.",
    "sun": "The sun stood at least {value}\u00b0 above the horizon ({worst}, the lowest).",
    "sun-noon": "The sun reached at least {value}\u00b0 at noon of the days of exposure ({worst}, "
    "the lowest); the times of day are not known.",
    "sun-low": "Photos taken with the sun below {limit}\u00b0, even at noon where only their date "
    "is known: {over}; the lowest {value}\u00b0 ({worst}).",
    "faults": "Faults marked in the mosaic: {count}, all closed.",
    "sheets-accepted": "The lot of map sheets is accepted by its sample: {bad} of {sample} sheets "
    "are bad, up to {accepted} may be (lot: {lot}). With {bad_percent} % bad sheets a lot would be "
    "accepted {consumer} times in 100.",
    "sheets-rejected": "The lot of map sheets is rejected by its sample: {bad} of {sample} sheets "
    "are bad, more than {accepted} (lot: {lot}). With {good_percent} % bad sheets a lot would be "
    "rejected {producer} times in 100.",
    "sheets-open": "Sheets of the sample that nobody has judged yet: {open} of {sample}, bad so "
    "far: {bad} (lot: {lot}).",
    "sheets-changed": "The mosaic, its map sheets or the limits of the job have changed since the "
    "sample of {sample} sheets was drawn ({bad} bad): make the sheets, then draw another.",
    "sheets-rejected-before": "Earlier samples by which this lot of map sheets is rejected: "
    "{count}. Drawing another does not make it good.",
    "sheets-replaced": "A newer sample of sheets took the place of one that was being judged; "
    "sheets of it that were judged: {count}.",
    "faults-open": "Faults marked in the mosaic: {count}; still open: {open}.",
    "mosaic-gone": "The file of the mosaic is gone, or another program changed it: what is judged "
    "is not what lies on the disk.",
    "no-holes": "The mosaic has no holes inside it.",
    "holes": "Holes inside the mosaic: {count}, {area:,.0f} m² together; the largest "
    "({largest:,.0f} m²) is about E {east} N {north}. No photo shows the ground there, or only a "
    "part that is left out, or something higher hides it, or the DEM has no height.",
    "misfit-places": "Places where the mosaic is further off the reference than predicted: "
    "{count}; the worst by {metres} m, about E {east} N {north}.",
    "read": "Places of the plan that were read: {read} of {planned} (not identifiable: "
    "{unreadable}).",
    "read-replaced": "A newer plan took the place of one that was read; places whose readings no "
    "longer count: {count}.",
    "read-late": "The places were drawn after control had been searched: they prove less than "
    "places that are drawn before.",
    "read-outdated": "Readings made in an earlier mosaic, which do not count: {count}.",
    "read-few": "Places of the plan that were read: {read} of {planned} (not identifiable: "
    "{unreadable}); {least} are asked for.",
    "read-within": "Readings of the mosaic: m_p {value} m ({low} to {high} m), within {limit} m.",
    "read-over": "Readings of the mosaic: m_p {value} m ({low} to {high} m), more than {limit} m.",
    "read-unsure": "Readings of the mosaic: m_p {value} m ({low} to {high} m), not proved to "
    "be within {limit} m.",
    "read-over-before": "Readings of an earlier plan: m_p {value} m ({low} to {high} m), more than "
    "{limit} m. A new plan does not make the mosaic better.",
    "read-unplanned": "No check places have been planned or read; {least} are asked for.",
    "read-shifted": "The mosaic is shifted against the reference by {east} m east and {north} m "
    "north on average, more than chance explains.",
    "read-unshifted": "No shift of the mosaic against the reference: {east} m east and {north} m "
    "north on average, as chance explains.",
    "second": "Places read by a second observer: {doubled} of {read}. One reading is good to "
    "{value} m: {share} % of the mean square difference is the observers'.",
    "second-few": "Places read by a second observer: {doubled} of {read}, {least} are the rule. "
    "One reading is good to {value} m: {share} % of the mean square difference is the observers'.",
    "second-none": "No place was read by a second observer, {least} are the rule: how much of the "
    "differences is the observer's is not known.",
    "read-as-predicted": "The readings bear the prediction out: {ratio} times the predicted "
    "{predicted} m (by chance {low} to {high}).",
    "read-worse": "The readings differ by {ratio} times the predicted {predicted} m, more than "
    "chance explains ({low} to {high}): the prediction cannot be trusted.",
    "read-better": "The readings differ by {ratio} times the predicted {predicted} m, less than "
    "chance explains ({low} to {high}): standard deviations are stated too large.",
    "predicted-within": "Position is predicted to {relative} m relative to the reference ortho, "
    "and to {value} m on the ground with the reference's own error, within {limit} m.",
    "predicted-unknown": "Position on the ground cannot be predicted: nothing was adjusted.",
    "predicted": "Position is predicted to {relative} m relative to the reference ortho, and to "
    "{value} m on the ground with the reference's own error: more than {limit} m.",
    "predicted-alone-within": "Position is predicted to {value} m on the ground, within {limit} m.",
    "predicted-alone": "Position is predicted to {value} m on the ground: more than {limit} m.",
}
"""What each finding says."""
CLASSES: Mapping[str, str] = {
    "tie": "tie points in the photos",
    "control_image": "control points in the photos",
    "control_plan": "control points in plan",
    "control_height": "control points in height",
    "dem": "tie points against the terrain",
    "centre": "measured perspective centres",
    "angles": "measured angles",
}
