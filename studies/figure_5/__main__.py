from studies import figure_5

figure_5.STUDY.run(figure_5.__doc__)
