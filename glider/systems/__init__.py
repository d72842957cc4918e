"""Drake Systems: the glider, its servo, an observer, noise.

Shells of ports and context round `glider.physics`; `diagrams` wires them.
"""
