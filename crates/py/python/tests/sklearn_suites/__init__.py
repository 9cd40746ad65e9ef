"""scikit-learn's own tests on fleetfoot's classes: what runs them, and what is known not to pass, with the reason."""
