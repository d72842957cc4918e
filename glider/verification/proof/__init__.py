"""The proof of a funnel, without a solver and without trust in how it was made.

check: the verdict about a certificate. purpose: whether it is of the problem and the
glider that are meant. exact_check: the part in whole numbers. remainder_proof: that the
Taylor remainder is within the bounds that the certificate assumes. enclosure: that
remainder on boxes of deviations. boxes: polynomials on boxes. words: what was checked,
in sentences.

Theorem. Let a funnel pass `check_funnel` with a problem, and `prove_remainder`, both
with every = 1. Then at each of its times t_k the set E_k = {x₀ + e: eᵀ S_k e <= 1} is
an ellipsoid on which the servo does as it is told, and on its boundary
    eᵀ Ṡ e + 2 eᵀ S (f(x₀ + e, u₀ - K e) - f(x₀, u₀) + d) <= -slack eᵀ S e
for every d with |d_i| <= δ_i, the nominal's largest defect over the intervals that meet
in t_k (`glider.verification.dynamics.defect`). E_0 is about the problem's launch. The
last set lies in the goal about the nominal's end, and that within the hook's reach of
the wire.

Nothing follows between the times: there `check_funnel` looks for V̇ >= 0 by ascent, in
floating point, at three points of each interval, and does not look at R or the servo.
So "every flight stays inside" is not proven, but at each t_k that V falls.

Enclosed or exact: S_k > 0, the servo's limits, V̇ of the polynomials with β and δ (whole
numbers); δ (Taylor models in time); |R| <= β (Taylor models on boxes, what rounding
leaves of dropped coordinates included); E_T in the goal, to 1e-9 of it.
Floating point: the launch, the wire and the problem's bounds are compared to 1e-6 and
1e-4; of the rates that are linear (positions, pitch, elevator) the coefficients are
taken as computed, so that their rounding, 1e-16 of them, is left out.

Assumed: IEEE arithmetic; NumPy's functions err by less than 100 units in the last
place; f is the text of `glider.physics.chain` with the glider's numbers, in real
arithmetic; the feedback knows the true state and acts at once; the servo is
`glider.physics.servo`; Python, NumPy and this package do what they say.
"""
