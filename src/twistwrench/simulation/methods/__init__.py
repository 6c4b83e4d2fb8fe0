"""Integration methods: Runge–Kutta tableaus, variational integrators, and trial steps of the adaptive method."""
