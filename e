error[OV205]: omnivert montecarlo: invalid value for '--noise-k': Input should be less than or equal to 0.1
  help     omnivert montecarlo --help
