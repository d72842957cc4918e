"""The proof of a funnel, without a solver and without trust in how it was made.

check: the verdict about a certificate. exact_check: its part in whole numbers.
remainder_proof: that the Taylor remainder is within the bounds that the certificate
assumes. enclosure: that remainder on boxes of deviations. boxes: polynomials on boxes.
"""
