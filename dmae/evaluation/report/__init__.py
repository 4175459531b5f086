"""The report on clips: counts, errors and worst moments of each clip, and the page that shows them."""
