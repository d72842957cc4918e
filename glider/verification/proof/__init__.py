"""The proof of a funnel, without a solver and without trust in how it was made.

check: the verdict about a certificate, at its times. purpose: whether it is of the
intended problem and glider. exact_check: the part in exact arithmetic. flight_proof:
that no flight leaves, interval by interval. interval_proof: one of them. interval: its
polynomials in time, its servo, a ball that holds its sets, and the centers of a set of
gliders. interval_growth: that V falls. enclosure, boxes: that the Taylor remainder is
within the bounds that the certificate assumes. held: what held commands are off by.
phases: several funnels, for a clock of any phase.

Between its times t_k a funnel is this: with τ from 0 to 1, x₀ and S are cubic Hermite
polynomials, u₀ and K straight lines; its sets are E(t) = {x₀ + e: eᵀ S e <= 1}, and its
feedback is u = u₀ - K (x - x₀).

Theorem. Let a funnel pass `check_funnel` with a problem, and let `prove_flights` be
whole. Then every flight of its glider, ẋ = f(x, servo(u)), that starts in E(0), which
is about the problem's launch, is in E(t) at every time 0 <= t <= T; its servo follows
every command; and it ends in the goal, within the hook's reach of the wire. For a
funnel made with a command error κ and a wind w̄ that holds with every |d_u(t)| <= κ and
|w(t)| <= w̄: ẋ = f(x, servo(u + d_u); w).

Proof. With V = eᵀ S e, on each interval and for all of its times and deviations
1. S is positive definite, and on E neither limit of the servo is met: b > 0 and
   b² S - a aᵀ > 0 for each limit aᵀ e < b, less what κ takes. So ẋ = f(x, u + d_u; w).
2. ė = P(τ, e) + G (d_u, w) + R + d, P a straight line in time between the third-order
   Taylor polynomials of f at both ends, with the feedback inserted, and G(τ, e) one
   between those of first order of ∂f / ∂(u, w) there. d is the nominal's defect in the
   linear rates, |d| <= δ; R is the rest of f - ẋ₀ - P - G (d_u, w) in the others, and
   |R_k| <= β_k (1 + eᵀ F e) on E, which is positive; β and F are straight lines in
   time, and F is of the states that R depends on.
3. On V = 1, for λ_k and μ_k straight lines between λ_k and β_k² / λ_k,
   2 eᵀ S R <= (Σ λ_k (S e)_k² + μ_k V)(1 + eᵀ F e), because β_k² <= λ_k μ_k: √(λ μ)
   is concave. Likewise, of the columns B and G_w of G,
   2 eᵀ S G (d_u, w) <= λ_u (Bᵀ S e)² + μ_u + λ_w |G_wᵀ S e|² + μ_w, quartic in e.
   And 2 eᵀ S d <= 2 √(δᵀ |S| δ).
4. So V̇ <= -slack there, if a polynomial in e and τ is positive, which it is where a
   Gram matrix with its Bernstein coefficients is (`interval_growth`).
A flight that left would have a last time with V = 1, and V > 1 after it: against 4.

A funnel of a set of gliders (`moving_center`) has the theorem for all of them: a glider
whose parameters deviate by δ flies in {x₀ + X δ + e: eᵀ S e <= 1}, X(0) = 0, X the
cubic Hermite polynomial integrated along the nominal. In 1, b is less max aᵀ X δ; in 2,
R is of f(x₀ + X δ + e, u; c₀ + δ) - ẋ₀ - Ẋ δ - P, for all δ of the set, and the defect
of X δ in the linear rates is in d. 3 and 4 do not change. The last set about each
center is in the goal by the triangle inequality in the goal's norm, to 1e-9.

After `check_funnel` alone, or with every > 1, this is known at the times, or on the
intervals, that were examined, and nothing follows for a whole flight.

Exact: 1 and 4, and that the balls of 2 hold E; at the end, E(T) in the goal to 1e-9.
Enclosed, rounding included: R (Taylor models on boxes of deviations and time) and δ
(Taylor models in time).
Floating point: the launch, the wire and the problem's bounds are compared to 1e-6 and
1e-4, the goal about the gliders' centers to 1e-9; the coefficients of the linear rates
(positions, pitch, elevator) are taken as computed, so that their rounding, 1e-16 of
them, is omitted, and so is that of the cubic polynomials' coefficients.

Assumed: IEEE arithmetic; NumPy's functions are accurate to 100 units in the last
place; f is the text of `glider.physics.chain` with the glider's parameters, in real
arithmetic; the feedback knows the true state and acts at once, but for κ; the servo is
`glider.physics.servo`; Python, NumPy, FLINT and this package are correct; so were they
when the file that a proof resumes from was written.
"""
