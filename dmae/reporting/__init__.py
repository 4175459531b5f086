"""Can I see it: tables, figures and pages."""
