"""From pose samples to uncertainties and to what each cause contributes."""
